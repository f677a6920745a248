//! Puts two runs of the bench side by side.

use crate::stdout;
use anyhow::{Context, Result, bail};
use ibgs_train::bench::{Configuration, Report, Timing};
use std::fs;
use std::path::Path;

/// Reads what an earlier run wrote by `--json`.
pub fn read(path: &Path) -> Result<Report> {
    let text = fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    let report = serde_json::from_str(&text);
    report.with_context(|| format!("{} is no file of `ibgs bench --json`", path.display()))
}

/// Refuses an earlier run that has nothing in common with this one.
pub fn check(before: &Report, now: &Report, path: &Path) -> Result<()> {
    if now.configurations.iter().all(|configuration| partner(before, configuration).is_none()) {
        bail!("{} has no configuration in common with this run; give it the same lists of values", path.display());
    }
    Ok(())
}

/// Prints the configurations that both have, and says which have no partner.
pub fn print(before: &Report, now: &Report) {
    stdout!();
    for (when, Report { version, device, .. }) in [("before", before), ("now", now)] {
        stdout!("{when:<6} {} ({}, {}), ibgs {version}", device.name, device.backend, device.driver);
    }
    for configuration in &now.configurations {
        stdout!();
        match partner(before, configuration) {
            None => stdout!("{}: not measured before", title(configuration)),
            Some(earlier) => {
                stdout!("{:<56} {:>10} {:>10} {:>7}", title(configuration), "before ms", "now ms", "ratio");
                for timing in &configuration.timings {
                    if let Some(earlier) = earlier.timing(timing.work) {
                        print_timing(earlier, timing);
                    }
                }
            }
        }
    }
}

fn print_timing(before: &Timing, now: &Timing) {
    let row = |name: &str, before: f64, now: f64| {
        let ratio = Some(now / before).filter(|ratio| ratio.is_finite()).map_or("-".to_owned(), |r| format!("{r:.2}"));
        stdout!("{name:<56} {before:>10.4} {now:>10.4} {ratio:>7}");
    };
    row(now.work.title(), before.ms, now.ms);
    row("  one after the other without waiting", before.in_a_row_ms, now.in_a_row_ms);
    for stage in &now.stages {
        let earlier = before.stages.iter().find(|earlier| earlier.stage == stage.stage);
        if let Some((before, now)) = earlier.and_then(|earlier| earlier.ms.zip(stage.ms)) {
            row(&format!("  {}", stage.stage), before, now);
        }
    }
}

/// The configuration of an earlier run with the same scene and the same numbers.
fn partner<'a>(before: &'a Report, now: &Configuration) -> Option<&'a Configuration> {
    let key =
        |c: &Configuration| (c.scene.clone(), c.width, c.height, c.load.gaussians, c.load.sources, c.load.medians);
    before.configurations.iter().find(|earlier| key(earlier) == key(now))
}

fn title(configuration: &Configuration) -> String {
    let Configuration { scene, width, height, load, .. } = configuration;
    format!("{scene}, {} Gaussians, {width} x {height}, {} sources, K = {}", load.gaussians, load.sources, load.medians)
}
