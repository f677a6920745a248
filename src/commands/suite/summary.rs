//! The measured figures of a suite beside the published ones.

use super::config::{Job, Published, Suite};
use anyhow::Result;
use ibgs_core::config::Method;
use ibgs_core::output::{OutputFolder, figures};
use serde_json::{Value, json};

/// A column of the tables.
struct Column {
    /// Name in the JSON.
    name: &'static str,
    /// Title in the table.
    head: &'static str,
    digits: usize,
    /// The published figure.
    published: fn(&Published) -> Option<f64>,
}

const fn column(
    name: &'static str,
    head: &'static str,
    digits: usize,
    published: fn(&Published) -> Option<f64>,
) -> Column {
    Column { name, head, digits, published }
}

/// Scores are those of the final image, or of the base if the run has no residual. `PSNR_aligned` is taken after an affine
/// map of the colours. Frames per second keep nothing from frame to frame, as in published figures. Storage is that of
/// Gaussians, photos, poses and network.
const COLUMNS: [Column; 12] = [
    column("PSNR", "PSNR", 2, |p| p.psnr),
    column("PSNR_aligned", "aligned PSNR", 2, |_| None),
    column("SSIM", "SSIM", 4, |p| p.ssim),
    column("LPIPS", "LPIPS", 3, |p| p.lpips),
    column("base_PSNR", "base PSNR", 2, |_| None),
    column("F1", "F1", 3, |p| p.f1),
    column("chamfer", "Chamfer", 4, |p| p.chamfer),
    column("gaussians_m", "Gaussians (M)", 3, |p| p.gaussians_m),
    column("minutes", "minutes", 2, |p| p.minutes),
    column("FPS", "FPS", 1, |p| p.fps),
    column("storage_mb", "storage (MB)", 1, |p| p.storage_mb),
    column("memory_gb", "memory (GB)", 2, |p| p.memory_gb),
];

/// The measured figures of one job, one value per column.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Figures([Option<f64>; COLUMNS.len()]);

impl Figures {
    /// Reads the figures in a job's model folder.
    pub fn read(job: &Job) -> Result<Self> {
        let found = figures::Figures::read(&OutputFolder::at(&job.folder), job.config.iterations())?;
        let means = |scores: &Option<figures::Scores>| scores.as_ref().map(|scores| scores.means.clone());
        let base = means(&found.base).unwrap_or_default();
        let image = means(&found.image).filter(|_| job.config.method == Method::Ibgs);
        let best = image.unwrap_or_else(|| base.clone());
        let speed = found.speed.unwrap_or_default();
        let mesh = found.mesh.unwrap_or_default();
        let million = |count: u64| 1e-6 * count as f64;
        Ok(Self([
            best.psnr,
            best.aligned_psnr,
            best.ssim,
            best.lpips,
            base.psnr,
            mesh.f_scores.first().map(|score| score.f1),
            mesh.chamfer.chamfer,
            speed.gaussians.map(million),
            found.time.and_then(|time| time.seconds).map(|seconds| seconds / 60.0),
            speed.fps_cold.or(speed.fps_warm),
            speed.storage_bytes.total().map(million),
            speed.memory_reserved_bytes.map(|bytes| 1e-3 * million(bytes)),
        ]))
    }

    /// Whether the column of this name has a value.
    pub fn has(&self, name: &str) -> bool {
        COLUMNS.iter().zip(self.0).any(|(column, value)| column.name == name && value.is_some())
    }

    fn of(published: &Published) -> Self {
        Self(COLUMNS.map(|column| (column.published)(published)))
    }

    /// The mean of every column in which all have a value.
    fn mean(all: &[&Self]) -> Self {
        Self(std::array::from_fn(|column| {
            let sum: Option<f64> = all.iter().map(|figures| figures.0[column]).sum();
            sum.filter(|_| !all.is_empty()).map(|sum| sum / all.len() as f64)
        }))
    }

    fn cells(&self) -> impl Iterator<Item = String> {
        let cell = |(column, value): (&Column, Option<f64>)| match value {
            Some(value) => format!("{value:.*}", column.digits),
            None => "-".to_owned(),
        };
        COLUMNS.iter().zip(self.0).map(cell)
    }

    fn json(&self) -> Value {
        COLUMNS.iter().zip(self.0).map(|(column, value)| (column.name.to_owned(), json!(value))).collect()
    }
}

/// A Markdown table with aligned columns.
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

/// The summary as Markdown: a table per scene, then one of the means, each with the published figures.
pub fn text(suite: &Suite, jobs: &[Job], figures: &[Figures]) -> String {
    let mut text = format!("# {}\n", suite.title);
    if !suite.note.is_empty() {
        text += &format!("\n{}\n", suite.note.trim());
    }
    let scenes: Vec<&str> = suite.scenes.iter().map(|scene| scene.name.as_str()).collect();
    let head: Vec<&str> = [""].into_iter().chain(COLUMNS.iter().map(|column| column.head)).collect();
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
        jobs.iter().zip(figures).filter(|(job, f)| !job.steps(f).is_empty()).map(|(job, _)| job.name()).collect();
    if !left.is_empty() {
        text += &format!("\nNot measured yet: {}.\n", left.join("; "));
    }
    text
}

/// The summary as JSON.
pub fn json(suite: &Suite, jobs: &[Job], figures: &[Figures]) -> Value {
    let measured = jobs.iter().zip(figures).map(|(job, figures)| {
        json!({
            "scene": job.scene, "run": job.run, "iterations": job.config.iterations(), "folder": job.folder,
            "figures": figures.json(),
        })
    });
    let published =
        suite.published.iter().map(|p| json!({ "method": p.method, "on": p.on, "figures": Figures::of(p).json() }));
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
        let figures = |psnr, fps| {
            let published = Published { psnr, fps, ..toml::from_str("method = 'a'").unwrap() };
            Figures::of(&published)
        };
        let mean = Figures::mean(&[&figures(Some(20.0), Some(1.0)), &figures(Some(30.0), None)]);
        assert_eq!(mean, figures(Some(25.0), None));
        assert!(mean.has("PSNR") && !mean.has("FPS"));
        assert_eq!(Figures::mean(&[]), Figures::default());
    }

    #[test]
    fn tables_stand_in_line() {
        let rows = [vec!["a".to_owned(), "1.00".to_owned()], vec!["long name".to_owned(), "-".to_owned()]];
        let text = table(&["", "PSNR"], &rows);
        assert_eq!(text, "|           | PSNR |\n|-----------|-----:|\n| a         | 1.00 |\n| long name |    - |\n");
    }
}
