//! `ibgs bench` on a tiny scene, and what it writes.

use super::Sandbox;
use ibgs_train::bench::{Report, Stage, Work};

/// Two rows: the usual values, and another number of Gaussians.
#[test]
fn a_growth_table_of_a_tiny_scene() {
    let sandbox = Sandbox::new();
    let lists = "--gaussians 200,1k --size 20x12 --sources 2 --intersections 2";
    let outcome = sandbox.succeeds(&format!("bench {lists} --iterations 5 --json out/bench.json"));
    for fragment in ["measured: copy ", "synthetic: 200 Gaussians", "20 x 12", ", 2 sources, K = 2", "floor ms"] {
        assert!(outcome.stdout.contains(fragment), "`{fragment}` is not in {outcome}");
    }
    for work in Work::ALL {
        assert!(outcome.stdout.contains(work.title()), "{outcome}");
    }
    let report: Report = serde_json::from_str(&sandbox.text("out/bench.json")).unwrap();
    assert!(report.rates.bytes_per_second > 0.0 && report.rates.operations_per_second > 0.0, "{:?}", report.rates);
    assert!(!report.device.name.is_empty() && report.device.limits.max_buffer_size > 0, "{:?}", report.device);
    assert_eq!(report.runs, 5);
    let rows: Vec<_> =
        report.configurations.iter().map(|c| (c.load.gaussians, c.width, c.load.sources, c.load.medians)).collect();
    assert_eq!(rows, [(200, 20, 2, 2), (1000, 20, 2, 2)]);
    let table = outcome.stdout.lines().filter(|line| line.contains("20x12")).count();
    assert_eq!(table, rows.len(), "{outcome}");
    for configuration in &report.configurations {
        let load = &configuration.load;
        assert!(load.gaussians_in_view <= load.gaussians && load.intersections >= load.gaussians_in_view, "{load:?}");
        assert!(load.pairs > 0 && load.pixels == 20 * 12 && load.tiles == 2 && load.most_visible > 0, "{load:?}");
        let works: Vec<_> = configuration.timings.iter().map(|timing| timing.work).collect();
        assert_eq!(works, Work::ALL);
        for timing in &configuration.timings {
            assert!(timing.ms > 0.0 && timing.fastest_ms <= timing.ms && timing.in_a_row_ms > 0.0, "{timing:?}");
            assert!(0.0 < timing.host_ms && timing.host_ms <= timing.in_a_row_ms, "{timing:?}");
            assert_eq!(timing.busy().is_some(), report.device.timestamps, "{timing:?}");
            assert!(timing.busy().is_none_or(|busy| 0.0 < busy && busy <= 1.0), "{timing:?}");
            assert!(timing.floor_ms > 0.0, "{timing:?}");
            for stage in timing.work.stages().into_iter().map(Stage::name) {
                let found = timing.stages.iter().find(|timing| timing.stage == stage);
                let found = found.unwrap_or_else(|| panic!("no {stage} in {timing:?}"));
                assert!(found.floor_ms.unwrap() > 0.0, "{found:?}");
                assert_eq!(found.ms.is_some(), report.device.timestamps, "{found:?}");
                assert!(found.ms.is_none_or(|ms| ms >= 0.0), "{found:?} in {:?}", timing.work);
            }
        }
        let memory = configuration.memory.as_ref().unwrap();
        let kinds: u64 = memory.kinds.iter().map(|kind| kind.bytes).sum();
        assert_eq!(kinds, memory.allocated_bytes);
        assert!(memory.kinds.iter().any(|kind| kind.name == "Adam moments"), "{:?}", memory.kinds);
        println!("{} bytes allocated, {} estimated", memory.allocated_bytes, configuration.estimated_bytes);
    }
    let base = report.configurations[0].timing(Work::BaseIteration).unwrap();
    assert!(base.stages.iter().all(|timing| timing.stage != "warp"), "{base:?}");
}

#[test]
fn a_run_is_compared_with_an_earlier_one() {
    let sandbox = Sandbox::new();
    let bench = "bench --size 20x12 --sources 2 --intersections 2 --iterations 5";
    sandbox.succeeds(&format!("{bench} --gaussians 200 --json before.json"));
    let outcome = sandbox.succeeds(&format!("{bench} --gaussians 200,300 --compare before.json"));
    let compared = outcome.stdout.split("before ms").nth(1).unwrap();
    for work in Work::ALL {
        let line = compared.lines().find(|line| line.starts_with(work.title())).unwrap();
        let numbers = line[work.title().len()..].split_whitespace().map(|number| number.parse().unwrap());
        let numbers: Vec<f64> = numbers.collect();
        assert!(matches!(numbers[..], [before, now, ratio] if (now / before - ratio).abs() < 0.02), "{line}");
    }
    assert!(compared.contains("300 Gaussians, 20 x 12, 2 sources, K = 2: not measured before"), "{outcome}");

    sandbox.write("other.json", "{\"version\": 3}");
    for (file, reason) in [("nowhere.json", "cannot read"), ("other.json", "no file of `ibgs bench --json`")] {
        sandbox.fails(&format!("{bench} --compare {file}"), &[file, reason]);
    }
    sandbox.fails(&format!("{bench} --gaussians 400 --compare before.json"), &["no configuration in common"]);
}

#[test]
fn a_submission_has_fixed_configurations_and_their_rows() {
    let sandbox = Sandbox::new();
    let outcome = sandbox.succeeds("bench --submit card.json --iterations 5");
    let report: Report = serde_json::from_str(&sandbox.text("card.json")).unwrap();
    let measured: Vec<_> =
        report.configurations.iter().map(|c| (c.load.gaussians, c.width, c.height, c.load.sources)).collect();
    assert_eq!(measured, [(10_000, 160, 120, 4)]);
    let rows: Vec<_> = outcome.stdout.lines().filter(|line| line.starts_with("| ")).collect();
    assert_eq!(rows.len(), 1, "{outcome}");
    assert!(rows[0].contains(&report.device.name), "{outcome}");
    let cells: Vec<_> = rows[0].split('|').map(str::trim).collect();
    let times: Vec<String> =
        report.configurations[0].timings.iter().map(|timing| format!("{:.2}", timing.in_a_row_ms)).collect();
    assert_eq!(cells[5..5 + times.len()], times, "{outcome}");
    let outcome = sandbox.run("bench --submit card.json --gaussians 1k");
    assert!(outcome.code == Some(2) && outcome.stderr.contains("cannot be used with"), "{outcome}");
}
