//! Prints the figures as tables.

use crate::stdout;
use ibgs_core::gpu::Bytes;
use ibgs_train::bench::{Configuration, Rates, Report, Timing, Work};
use std::path::Path;

/// Prints the rates from which the floors are computed.
pub fn print_rates(rates: &Rates) {
    let (bytes, operations) = (1e-9 * rates.bytes_per_second, 1e-12 * rates.operations_per_second);
    stdout!("measured: copy {bytes:.1} GB/s read and written, multiply-adds {operations:.3} Tflop/s");
}

/// Prints every stage of a configuration beside its floor.
pub fn print_stages(configuration: &Configuration) {
    let Configuration { scene, width, height, load, .. } = configuration;
    stdout!();
    stdout!(
        "{scene}: {} Gaussians, {} in view, {width} x {height}, {} tile intersections, {:.1} entries a pixel, \
         {} sources, K = {}",
        load.gaussians,
        load.gaussians_in_view,
        load.intersections,
        load.pairs as f64 / load.pixels.max(1) as f64,
        load.sources,
        load.medians
    );
    for timing in &configuration.timings {
        print_timing(timing);
    }
    if let Some(memory) = &configuration.memory {
        stdout!();
        stdout!(
            "device memory of the ibgs iteration: {} reserved, {} in buffers, {} estimated",
            Bytes(memory.reserved_bytes),
            Bytes(memory.allocated_bytes),
            Bytes(configuration.estimated_bytes)
        );
    }
}

fn print_timing(timing: &Timing) {
    stdout!();
    stdout!("{:<50} {:>10} {:>10} {:>7}", timing.work.title(), "ms", "floor ms", "ratio");
    let number = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.4}"));
    let ratio = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.1}"));
    for stage in &timing.stages {
        let [ms, floor] = [stage.ms, stage.floor_ms].map(number);
        stdout!("  {:<48} {ms:>10} {floor:>10} {:>7}", stage.stage, ratio(stage.ratio()));
    }
    let whole = ratio(Some(timing.ms / timing.floor_ms).filter(|ratio| ratio.is_finite()));
    stdout!("  {:<48} {:>10.4} {:>10.4} {whole:>7}", "whole, wall clock", timing.ms, timing.floor_ms);
    stdout!("  {:<48} {:>10.4}", "one after the other without waiting", timing.in_a_row_ms);
    stdout!("  {:<48} {:>10.4}", "host's part of that", timing.host_ms);
    if let Some((ms, busy)) = timing.kernels_ms().zip(timing.busy()) {
        let all = format!("all kernels: GPU busy for {:.0} %", 100.0 * busy);
        stdout!("  {all:<48} {ms:>10.4}");
    }
}

/// Prints one row per configuration; nothing if there is only one.
pub fn print_growth(configurations: &[Configuration]) {
    if configurations.len() < 2 {
        return;
    }
    stdout!();
    stdout!(
        "{:>10} {:>11} {:>7} {:>2} {:>13} {:>10} {:>11} {:>11} {:>13} {:>13} {:>10}",
        "Gaussians",
        "size",
        "sources",
        "K",
        "intersections",
        "base frame",
        "final, warm",
        "final, cold",
        "3dgs training",
        "ibgs training",
        "memory"
    );
    for configuration in configurations {
        let load = &configuration.load;
        let size = format!("{}x{}", configuration.width, configuration.height);
        let ms = |work: Work| configuration.timing(work).map_or("-".to_owned(), |timing| format!("{:.3}", timing.ms));
        let [base, warm, cold, plain, full] = Work::ALL.map(ms);
        let memory = configuration.memory.as_ref().map_or("-".to_owned(), |m| Bytes(m.allocated_bytes).to_string());
        stdout!(
            "{:>10} {size:>11} {:>7} {:>2} {:>13} {base:>10} {warm:>11} {cold:>11} {plain:>13} {full:>13} {memory:>10}",
            load.gaussians,
            load.sources,
            load.medians,
            load.intersections
        );
    }
    stdout!("times in ms, medians of single runs by the clock");
}

/// Prints the rows of the table of adapters in docs/benchmarks.md, and what to do with them.
pub fn print_rows(report: &Report, path: &Path) {
    let Report { version, device, configurations, .. } = report;
    stdout!();
    stdout!("{} and these rows of \"By adapter\" in docs/benchmarks.md are the submission:", path.display());
    for Configuration { width, height, load, timings, .. } in configurations {
        let what = format!("{} Gaussians, {width} x {height}", load.gaussians);
        let times: String = timings.iter().map(|timing| format!(" {:.2} |", timing.in_a_row_ms)).collect();
        stdout!("| {} | {}, {} | {version} | {what} |{times}", device.name, device.backend, device.driver.trim());
    }
}
