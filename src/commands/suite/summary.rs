//! What a suite has measured, beside what was published.

use super::config::{Job, Published, Suite};
use anyhow::{Context, Result};
use ibgs_core::train::config::Method;
use serde_json::{Value, json};
use std::path::Path;

/// What was measured of one job; none where it was not.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Figures {
    /// The final image; the base where the run has no residual.
    pub psnr: Option<f64>,
    /// Structural similarity of that image.
    pub ssim: Option<f64>,
    /// LPIPS of that image.
    pub lpips: Option<f64>,
    /// The base image.
    pub base_psnr: Option<f64>,
    /// Number of Gaussians, in millions.
    pub gaussians_m: Option<f64>,
    /// Minutes of training.
    pub minutes: Option<f64>,
    /// Frames a second with nothing kept from frame to frame, as published figures have it.
    pub fps: Option<f64>,
    /// Gaussians, photos, poses and network, in MB.
    pub storage_mb: Option<f64>,
    /// Device memory after rendering, in GB.
    pub memory_gb: Option<f64>,
}

/// A results file's entry of an iteration; null where there is none.
fn entry(path: &Path, iteration: u32) -> Result<Value> {
    let text = match std::fs::read_to_string(path) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Value::Null),
        text => text.with_context(|| format!("cannot read {}", path.display()))?,
    };
    let all: Value =
        serde_json::from_str(&text).with_context(|| format!("{} is damaged; remove it", path.display()))?;
    Ok(all.get(format!("ours_{iteration}")).cloned().unwrap_or_default())
}

impl Figures {
    /// Reads what a job has left in its model folder.
    pub fn read(job: &Job) -> Result<Self> {
        let iteration = job.config.iterations;
        let read = |file: &str| entry(&job.folder.join(file), iteration);
        let (base, image) = (read("results_renders.json")?, read("results_renders_aggregate.json")?);
        let (speed, training) = (read("result_fps_mem.json")?, read("result_training.json")?);
        let best = if job.config.method == Method::Ibgs && !image.is_null() { &image } else { &base };
        let storage = ["gaussians", "network", "poses", "photos"].map(|part| speed["storage_bytes"][part].as_f64());
        let sum: f64 = storage.iter().flatten().sum();
        let frames = speed["FPS_cold"].as_f64().or(speed["FPS_warm"].as_f64());
        Ok(Self {
            psnr: best["PSNR"].as_f64(),
            ssim: best["SSIM"].as_f64(),
            lpips: best["LPIPS"].as_f64(),
            base_psnr: base["PSNR"].as_f64(),
            gaussians_m: speed["gaussians"].as_f64().map(|count| 1e-6 * count),
            minutes: training["seconds"].as_f64().map(|seconds| seconds / 60.0),
            fps: frames,
            storage_mb: Some(1e-6 * sum).filter(|&mb| mb > 0.0),
            memory_gb: speed["memory_reserved_bytes"].as_f64().map(|bytes| 1e-9 * bytes),
        })
    }

    /// Whether quality and speed were measured.
    pub fn is_complete(&self) -> bool {
        self.psnr.is_some() && self.fps.is_some()
    }

    fn of(p: &Published) -> Self {
        let Published { psnr, ssim, lpips, fps, minutes, storage_mb, memory_gb, gaussians_m, .. } = *p;
        Self { psnr, ssim, lpips, base_psnr: None, gaussians_m, minutes, fps, storage_mb, memory_gb }
    }

    fn values(&self) -> [Option<f64>; 9] {
        let Self { psnr, ssim, lpips, base_psnr, gaussians_m, minutes, fps, storage_mb, memory_gb } = *self;
        [psnr, ssim, lpips, base_psnr, gaussians_m, minutes, fps, storage_mb, memory_gb]
    }

    /// Means of what all of them have.
    fn mean(all: &[&Self]) -> Self {
        let lists: Vec<_> = all.iter().map(|figures| figures.values()).collect();
        let mean = |column: usize| -> Option<f64> {
            let sum: Option<f64> = lists.iter().map(|values| values[column]).sum();
            sum.filter(|_| !lists.is_empty()).map(|sum| sum / lists.len() as f64)
        };
        let [psnr, ssim, lpips, base_psnr, gaussians_m, minutes, fps, storage_mb, memory_gb] =
            std::array::from_fn(mean);
        Self { psnr, ssim, lpips, base_psnr, gaussians_m, minutes, fps, storage_mb, memory_gb }
    }

    fn cells(&self) -> [String; 9] {
        let digits = [2, 4, 3, 2, 3, 2, 1, 1, 2];
        let values = self.values();
        std::array::from_fn(|i| values[i].map_or_else(|| "-".to_owned(), |value| format!("{value:.*}", digits[i])))
    }

    fn json(&self) -> Value {
        let names = ["PSNR", "SSIM", "LPIPS", "base_PSNR", "gaussians_m", "minutes", "FPS", "storage_mb", "memory_gb"];
        names.iter().zip(self.values()).map(|(name, value)| ((*name).to_owned(), json!(value))).collect()
    }
}

const HEAD: [&str; 9] =
    ["PSNR", "SSIM", "LPIPS", "base PSNR", "Gaussians (M)", "minutes", "FPS", "storage (MB)", "memory (GB)"];

/// A Markdown table whose columns stand in line.
fn table(head: &[&str], rows: &[Vec<String>]) -> String {
    let width = |column: usize| {
        let cells = rows.iter().map(|row| row[column].chars().count());
        cells.chain([head[column].chars().count(), 3]).max().unwrap_or_default()
    };
    let widths: Vec<usize> = (0..head.len()).map(width).collect();
    let line = |cells: &[String]| {
        let cells = cells.iter().zip(&widths).enumerate();
        let padded = cells.map(|(i, (cell, &w))| if i == 0 { format!("{cell:<w$}") } else { format!("{cell:>w$}") });
        format!("| {} |\n", padded.collect::<Vec<_>>().join(" | "))
    };
    let rule = widths.iter().enumerate().map(|(i, &w)| match i {
        0 => format!("|{}", "-".repeat(w + 2)),
        _ => format!("|{}:", "-".repeat(w + 1)),
    });
    let mut text = line(&head.iter().map(|&cell| cell.to_owned()).collect::<Vec<_>>());
    text += &format!("{}|\n", rule.collect::<String>());
    rows.iter().for_each(|row| text += &line(row));
    text
}

fn row(name: String, figures: &Figures) -> Vec<String> {
    [name].into_iter().chain(figures.cells()).collect()
}

/// Figures of one scene, then of the means, each beside the published ones.
pub fn text(suite: &Suite, jobs: &[Job], figures: &[Figures]) -> String {
    let mut text = format!("# {}\n", suite.title);
    if !suite.note.is_empty() {
        text += &format!("\n{}\n", suite.note.trim());
    }
    let scenes: Vec<&str> = suite.scenes.iter().map(|scene| scene.name.as_str()).collect();
    let head: Vec<&str> = [""].into_iter().chain(HEAD).collect();
    let published = |on: &str| -> Vec<Vec<String>> {
        let rows = suite.published.iter().filter(|p| p.on == on);
        rows.map(|p| row(format!("{} (published)", p.method), &Figures::of(p))).collect()
    };
    for &scene in &scenes {
        let ours = jobs.iter().zip(figures).filter(|(job, _)| job.scene == scene);
        let mut rows: Vec<Vec<String>> = ours.map(|(job, figures)| row(job.run.clone(), figures)).collect();
        if rows.is_empty() {
            text += &format!("\n## {scene}\n\nNot there.\n");
            continue;
        }
        rows.extend(published(scene));
        text += &format!("\n## {scene}\n\n{}", table(&head, &rows));
    }
    let mut rows = Vec::new();
    for run in suite.runs.iter().filter(|_| scenes.len() > 1) {
        let all: Vec<&Figures> =
            jobs.iter().zip(figures).filter(|(job, _)| job.run == run.name).map(|(_, figures)| figures).collect();
        rows.push(row(run.name.clone(), &Figures::mean(&all)));
    }
    rows.extend(published(""));
    if !rows.is_empty() {
        let measured: Vec<&str> =
            scenes.iter().copied().filter(|scene| jobs.iter().any(|job| job.scene == *scene)).collect();
        let of = format!("{} of {} scenes", measured.len(), scenes.len());
        text += &format!("\n## Mean over {of}\n\n{}", table(&head, &rows));
    }
    let mut elsewhere: Vec<&str> = Vec::new();
    for p in suite.published.iter().filter(|p| !p.on.is_empty() && !scenes.contains(&p.on.as_str())) {
        if !elsewhere.contains(&p.on.as_str()) {
            elsewhere.push(&p.on);
        }
    }
    for on in elsewhere {
        text += &format!("\n## Published: {on}\n\n{}", table(&head, &published(on)));
    }
    let left: Vec<String> =
        jobs.iter().zip(figures).filter(|(_, f)| !f.is_complete()).map(|(job, _)| job.title()).collect();
    if !left.is_empty() {
        text += &format!("\nNot measured yet: {}.\n", left.join("; "));
    }
    text
}

/// The same for programs.
pub fn json(suite: &Suite, jobs: &[Job], figures: &[Figures]) -> Value {
    let measured = jobs.iter().zip(figures).map(|(job, figures)| {
        json!({
            "scene": job.scene, "run": job.run, "iterations": job.config.iterations, "folder": job.folder,
            "figures": figures.json(),
        })
    });
    let published = suite
        .published
        .iter()
        .map(|p| json!({ "method": p.method, "on": p.on, "F1": p.f1, "figures": Figures::of(p).json() }));
    json!({
        "title": suite.title,
        "measured": measured.collect::<Vec<_>>(),
        "published": published.collect::<Vec<_>>(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_need_every_figure() {
        let a = Figures { psnr: Some(20.0), fps: Some(1.0), ..Figures::default() };
        let b = Figures { psnr: Some(30.0), ..Figures::default() };
        let mean = Figures::mean(&[&a, &b]);
        assert_eq!((mean.psnr, mean.fps), (Some(25.0), None));
        assert_eq!(Figures::mean(&[]), Figures::default());
    }

    #[test]
    fn tables_stand_in_line() {
        let rows = [vec!["a".to_owned(), "1.00".to_owned()], vec!["long name".to_owned(), "-".to_owned()]];
        let text = table(&["", "PSNR"], &rows);
        assert_eq!(text, "|           | PSNR |\n|-----------|-----:|\n| a         | 1.00 |\n| long name |    - |\n");
    }
}
