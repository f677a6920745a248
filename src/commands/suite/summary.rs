//! What a suite has measured, beside what was published.

use super::config::{Job, Published, Suite};
use anyhow::Result;
use ibgs_core::train::config::Method;
use ibgs_core::train::output::{OutputFolder, figures};
use serde_json::{Value, json};

/// What was measured of one job; none where it was not.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Figures {
    /// The final image; the base where the run has no residual.
    pub psnr: Option<f64>,
    /// The same after an affine map of the colours.
    pub aligned_psnr: Option<f64>,
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

impl Figures {
    /// Reads what a job has left in its model folder.
    pub fn read(job: &Job) -> Result<Self> {
        let found = figures::Figures::read(&OutputFolder::at(&job.folder), job.config.iterations)?;
        let means = |scores: &Option<figures::Scores>| scores.as_ref().map(|scores| scores.means.clone());
        let base = means(&found.base).unwrap_or_default();
        let image = means(&found.image).filter(|_| job.config.method == Method::Ibgs);
        let best = image.unwrap_or_else(|| base.clone());
        let speed = found.speed.unwrap_or_default();
        let million = |count: u64| 1e-6 * count as f64;
        Ok(Self {
            psnr: best.psnr,
            aligned_psnr: best.aligned_psnr,
            ssim: best.ssim,
            lpips: best.lpips,
            base_psnr: base.psnr,
            gaussians_m: speed.gaussians.map(million),
            minutes: found.time.and_then(|time| time.seconds).map(|seconds| seconds / 60.0),
            fps: speed.fps_cold.or(speed.fps_warm),
            storage_mb: speed.storage_bytes.total().map(million),
            memory_gb: speed.memory_reserved_bytes.map(|bytes| 1e-3 * million(bytes)),
        })
    }

    /// Whether quality and speed were measured.
    pub fn is_complete(&self) -> bool {
        self.psnr.is_some() && self.fps.is_some()
    }

    fn of(p: &Published) -> Self {
        let Published { psnr, ssim, lpips, fps, minutes, storage_mb, memory_gb, gaussians_m, .. } = *p;
        Self {
            psnr,
            aligned_psnr: None,
            ssim,
            lpips,
            base_psnr: None,
            gaussians_m,
            minutes,
            fps,
            storage_mb,
            memory_gb,
        }
    }

    fn values(&self) -> [Option<f64>; 10] {
        let Self { psnr, aligned_psnr, ssim, lpips, base_psnr, gaussians_m, minutes, fps, storage_mb, memory_gb } =
            *self;
        [psnr, aligned_psnr, ssim, lpips, base_psnr, gaussians_m, minutes, fps, storage_mb, memory_gb]
    }

    /// Means of what all of them have.
    fn mean(all: &[&Self]) -> Self {
        let lists: Vec<_> = all.iter().map(|figures| figures.values()).collect();
        let mean = |column: usize| -> Option<f64> {
            let sum: Option<f64> = lists.iter().map(|values| values[column]).sum();
            sum.filter(|_| !lists.is_empty()).map(|sum| sum / lists.len() as f64)
        };
        let [psnr, aligned_psnr, ssim, lpips, base_psnr, gaussians_m, minutes, fps, storage_mb, memory_gb] =
            std::array::from_fn(mean);
        Self { psnr, aligned_psnr, ssim, lpips, base_psnr, gaussians_m, minutes, fps, storage_mb, memory_gb }
    }

    fn cells(&self) -> [String; 10] {
        let digits = [2, 2, 4, 3, 2, 3, 2, 1, 1, 2];
        let values = self.values();
        std::array::from_fn(|i| values[i].map_or_else(|| "-".to_owned(), |value| format!("{value:.*}", digits[i])))
    }

    fn json(&self) -> Value {
        let names = [
            "PSNR",
            "PSNR_aligned",
            "SSIM",
            "LPIPS",
            "base_PSNR",
            "gaussians_m",
            "minutes",
            "FPS",
            "storage_mb",
            "memory_gb",
        ];
        names.iter().zip(self.values()).map(|(name, value)| ((*name).to_owned(), json!(value))).collect()
    }
}

const HEAD: [&str; 10] = [
    "PSNR",
    "aligned PSNR",
    "SSIM",
    "LPIPS",
    "base PSNR",
    "Gaussians (M)",
    "minutes",
    "FPS",
    "storage (MB)",
    "memory (GB)",
];

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
