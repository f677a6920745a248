//! What `ibgs info` says of a model folder or a bundle.

use crate::advice;
use crate::commands::report::megabytes;
use crate::commands::train::DemoDefaults;
use crate::stdout;
use anyhow::Result;
use glam::DVec3;
use ibgs_core::config::{Method, TrainConfig};
use ibgs_core::ensemble::Member;
use ibgs_core::levels::Levels;
use ibgs_core::local_space::Length;
use ibgs_core::model::{Model, ModelError, ModelOptions};
use ibgs_core::output::cameras::Split;
use ibgs_core::output::figures::{Figures, Means};
use ibgs_core::progress::duration;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use toml::{Table, Value};

/// Names and values, one line each; a name is empty where a value has more lines.
type Rows = Vec<(&'static str, String)>;

/// Prints what a model is, how it was trained, and what was measured.
pub fn show(path: &Path) -> Result<()> {
    let model = Model::open(path, &ModelOptions::default())?;
    let figures = Figures::read(&model.folder, model.iteration)?;
    let kind = if model.bundle_bytes.is_some() { "bundle" } else { "model" };
    stdout!("{}: {kind} of iteration {} of {}", path.display(), model.iteration, model.config.iterations());
    let config = trained_with(&model)?;
    let rows =
        [contents(&model)?, measured(&figures), files(&model)?, options(&config, &usual(&model, &config))?].concat();
    let width = rows.iter().map(|(name, _)| name.len()).max().unwrap_or_default();
    rows.iter().for_each(|(name, value)| stdout!("   {name:<width$}   {value}"));
    Ok(())
}

/// The model itself.
fn contents(model: &Model) -> Result<Rows> {
    let config = &model.config;
    let mut rows = Rows::new();
    rows.push((
        "method",
        match (config.method, &model.network) {
            (Method::Ibgs, Some(_)) => "ibgs: Gaussians, and a residual from neighbouring photos".to_owned(),
            (Method::Ibgs, None) => "ibgs, without a residual at this iteration".to_owned(),
            (Method::Gs3, _) => "3dgs: Gaussians alone".to_owned(),
        },
    ));
    let scene = match (&config.source, model.has_made_scene()) {
        (Some(path), _) => path.display().to_string(),
        (None, true) => "the built-in demo scene".to_owned(),
        (None, false) => {
            "not named; other programs' models need `--source`, and `--resolution` if their photos were reduced"
                .to_owned()
        }
    };
    rows.push(("scene", scene));
    let held_out = model.cameras.iter().filter(|record| record.split == Some(Split::Test)).count();
    let (all, training) = (model.cameras.len(), model.cameras.len() - held_out);
    let size = match model.cameras.first() {
        Some(record) => format!("; the first {} x {} pixels", record.camera.width, record.camera.height),
        None => String::new(),
    };
    rows.push(("views", format!("{all}: {training} for training, {held_out} held out{size}")));
    rows.push((
        "photos",
        match model.check_photos() {
            Err(ModelError::NoScene { .. }) => format!("those of the {training} training views are in its scene"),
            Err(error) => format!("{}; the base image needs none", advice::of(&error)),
            Ok(()) if model.bundle_bytes.is_some() => {
                format!("those of the {training} training views are in the bundle")
            }
            Ok(()) => format!("those of the {training} training views are in the scene"),
        },
    ));
    let gaussians = &model.gaussians;
    let count = model.levels.as_ref().map_or(gaussians.len(), |levels| levels.len());
    rows.push(("Gaussians", format!("{count}, spherical harmonics of degree {}", gaussians.sh_degree)));
    let member = |member: &Member| member.gaussians.len().to_string();
    if !model.members.is_empty() {
        let further = model.members.iter().map(member).collect::<Vec<_>>().join(" and ");
        rows.push(("further bases", format!("{further} Gaussians; the base image is the mean of all")));
    }
    let chunks = |levels: &Arc<Levels>| format!("levels of detail in {} chunks", levels.nodes.len());
    rows.extend(model.levels.as_ref().map(|levels| ("chunks", chunks(levels))));
    rows.extend(place(model).map(|place| ("place", place)));
    let further = model.members.iter().filter(|member| member.network.is_some()).count();
    let weights = |network: &Vec<f32>| match further {
        0 => format!("{} weights", network.len()),
        further => format!("{} of {} weights each", 1 + further, network.len()),
    };
    rows.push(("network", model.network.as_ref().map_or_else(|| "none".to_owned(), weights)));
    let exposure = match model.exposure_field()? {
        Some(field) => format!("corrected; the photos differ by {:.1} %", 100.0 * field.spread()),
        None => "not corrected".to_owned(),
    };
    rows.push(("exposure", exposure));
    Ok(rows)
}

/// Where the Gaussians are; none where there are none.
fn place(model: &Model) -> Option<String> {
    let fold = |(low, high): (DVec3, DVec3), p: DVec3| (low.min(p), high.max(p));
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (low, high) = match &model.levels {
        Some(levels) => {
            let corners = [levels.nodes[0].low, levels.nodes[0].high].map(|p| levels.space.to_scene(p.as_dvec3()));
            corners.into_iter().fold(none, fold)
        }
        None => model.gaussians.positions().fold(none, fold),
    };
    let axis = |(i, name): (usize, &str)| format!("{name} {} to {}", Length(low[i]), Length(high[i]));
    let axes = || ["x", "y", "z"].into_iter().enumerate().map(axis).collect::<Vec<_>>().join(", ");
    (!model.gaussians.is_empty()).then(axes)
}

/// Scores, speed and time, as far as they are known.
fn measured(figures: &Figures) -> Rows {
    let mut rows = Rows::new();
    let line = |means: &Means| {
        let part = |name: &str, value: Option<f64>, digits: usize, unit: &str| {
            value.map(|value| format!("{name} {value:.digits$}{unit}"))
        };
        let parts =
            [part("PSNR", means.psnr, 3, " dB"), part("SSIM", means.ssim, 4, ""), part("LPIPS", means.lpips, 4, "")];
        parts.into_iter().flatten().collect::<Vec<_>>().join(", ")
    };
    let scores = [("final image", &figures.image), ("base image", &figures.base)];
    rows.extend(scores.into_iter().filter_map(|(name, scores)| Some((name, line(&scores.as_ref()?.means)))));
    if rows.is_empty() {
        rows.push(("scores", "not measured; `ibgs eval` does where views were held out".to_owned()));
    }
    if let Some(speed) = &figures.speed {
        let fps = speed.fps_cold.or(speed.fps_warm).map(|fps| format!("{fps:.1} frames a second on {}", speed.device));
        rows.extend(fps.map(|fps| ("speed", fps)));
    }
    if let Some(f_score) = figures.mesh.as_ref().and_then(|mesh| mesh.f_scores.first()) {
        rows.push(("mesh", format!("F1 {:.4} at {}", f_score.f1, Length(f_score.threshold))));
    }
    if let Some(time) = &figures.time {
        let seconds = time.seconds.map(|seconds| format!("{} on {}", duration(seconds), time.device));
        rows.extend(seconds.map(|seconds| ("training", seconds)));
        let names = std::iter::once("command").chain(std::iter::repeat(""));
        rows.extend(names.zip(time.commands.iter().cloned()));
    }
    rows
}

/// What lies on the disk.
fn files(model: &Model) -> Result<Rows> {
    if let Some(bytes) = model.bundle_bytes {
        return Ok(vec![("file", megabytes(bytes))]);
    }
    let folder = &model.folder;
    let mut rows = Rows::new();
    let saved: Vec<String> = folder.iterations()?.iter().map(u32::to_string).collect();
    rows.push(("saved", format!("iterations {}", saved.join(", "))));
    let mut parts = vec![format!("point cloud {}", megabytes(model.cloud_bytes().unwrap_or(0)))];
    if model.network_bytes > 0 {
        parts.push(format!("network {}", megabytes(model.network_bytes)));
    }
    parts.push(format!("whole folder {}", megabytes(folder_bytes(folder.root()))));
    rows.push(("files", parts.join(", ")));
    if let Some((iteration, _)) = folder.checkpoints()?.first() {
        let command = advice::resume(folder.root());
        rows.push(("stopped", format!("there is a checkpoint of iteration {iteration}; {command} continues from it")));
    }
    Ok(rows)
}

/// Bytes of all files below a folder; what cannot be read counts nothing.
fn folder_bytes(path: &Path) -> u64 {
    let Ok(entries) = std::fs::read_dir(path) else { return 0 };
    // A link is not followed: it may lead back.
    let bytes = |entry: std::fs::DirEntry| match entry.file_type() {
        Ok(kind) if kind.is_dir() => folder_bytes(&entry.path()),
        Ok(kind) if kind.is_file() => entry.metadata().map_or(0, |file| file.len()),
        _ => 0,
    };
    entries.flatten().map(bytes).sum()
}

/// The options of its training. A model that is opened has the precision that it is opened with, which says nothing here.
fn trained_with(model: &Model) -> Result<TrainConfig> {
    if model.bundle_bytes.is_none() && model.folder.config_path().is_file() {
        return Ok(model.folder.read_config()?);
    }
    let mut config = model.config.clone();
    config.residual.precision = TrainConfig::default().residual.precision;
    Ok(config)
}

/// The options that the training of a model would have had by default.
fn usual(model: &Model, config: &TrainConfig) -> TrainConfig {
    let views = model.training_views();
    let pixels = views.iter().map(|record| record.camera.pixels() as u64).sum();
    let mut usual = by_photos(config, views.len(), pixels);
    if model.has_made_scene() {
        let is_software = config.densify.max_splats == Some(DemoDefaults::SOFTWARE.max_splats);
        let defaults = if is_software { DemoDefaults::SOFTWARE } else { DemoDefaults::GPU };
        let mut filled = TrainConfig { init: config.init.clone(), ..TrainConfig::default() };
        defaults.fill(&mut filled);
        usual.iterations = filled.iterations;
        usual.densify.max_splats = filled.densify.max_splats;
        usual.residual.factor = filled.residual.factor;
    }
    if model.bundle_bytes.is_some() {
        // Its photos may be smaller than those of the training.
        usual.densify.max_splats = config.densify.max_splats;
    }
    usual
}

/// The default options with those that follow from the photos, and the learning rates from the length.
fn by_photos(config: &TrainConfig, photos: usize, pixels: u64) -> TrainConfig {
    let adapted = |iterations: Option<u32>| {
        let mut config = TrainConfig { iterations, ..config.clone() };
        (config.densify.max_splats, config.learning_rates.factor) = (None, None);
        config.adapt_to_photos(photos, pixels);
        config
    };
    let (by_photos, by_length) = (adapted(None), adapted(config.iterations));
    let ensemble = Some(config.usual_ensemble());
    let mut usual = TrainConfig { ensemble, iterations: by_photos.iterations, ..TrainConfig::default() };
    usual.densify.max_splats = by_photos.densify.max_splats;
    usual.learning_rates.factor = by_length.learning_rates.factor;
    usual
}

/// The options that differ from the usual ones, by their names in the options file.
fn options(config: &TrainConfig, usual: &TrainConfig) -> Result<Rows> {
    let leaves = |config: &TrainConfig| -> Result<BTreeMap<String, Value>> {
        let mut leaves = BTreeMap::new();
        flatten("", Table::try_from(config)?, &mut leaves);
        Ok(leaves)
    };
    let usual = leaves(usual)?;
    let changed = leaves(config)?.into_iter().filter(|(name, value)| usual.get(name) != Some(value));
    // The path of the scene has no default to differ from.
    let changed = changed.filter(|(name, _)| name != "source");
    let lines: Vec<String> = changed.map(|(name, value)| format!("{name} = {value}")).collect();
    if lines.is_empty() {
        return Ok(vec![("options", "all at their defaults".to_owned())]);
    }
    Ok(std::iter::once("options").chain(std::iter::repeat("")).zip(lines).collect())
}

fn flatten(prefix: &str, table: Table, into: &mut BTreeMap<String, Value>) {
    for (name, value) in table {
        match value {
            Value::Table(inner) => flatten(&format!("{prefix}{name}."), inner, into),
            value => {
                into.insert(format!("{prefix}{name}"), value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_those_that_differ() {
        let mut config = TrainConfig::default();
        let options = |config: &TrainConfig| options(config, &by_photos(config, 20, 90_000_000)).unwrap();
        let none = [("options", "all at their defaults".to_owned())];
        let mut adapted = config.clone();
        adapted.adapt_to_photos(20, 90_000_000);
        assert_eq!(options(&adapted), none);
        adapted.densify.max_splats = Some(3_000);
        assert_eq!(options(&adapted), [("options", "densify.max-splats = 3000".to_owned())]);
        config.source = Some("scene".into());
        config.iterations = Some(7);
        config.densify.growth.screen_size = 0.25;
        config.sh_degree = Some(1);
        let expected =
            [("options", "densify.growth.screen-size = 0.25"), ("", "iterations = 7"), ("", "sh-degree = 1")];
        config.adapt_to_photos(20, 90_000_000);
        assert_eq!(options(&config), expected.map(|(name, value)| (name, value.to_owned())));
    }
}
