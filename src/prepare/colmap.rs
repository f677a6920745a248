//! COLMAP's steps from photos to poses.

mod mapper;

pub use mapper::{ENOUGH, Mapper};

use super::tool::Tool;
use crate::arguments;
use anyhow::{Context, Result, bail};
use clap::ValueEnum;
use ibgs_core::progress::Progress;
use mapper::Mappers;
use serde::{Deserialize, Serialize};
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

/// The oldest version that has every command and option used here.
const OLDEST: [u32; 2] = [3, 6];

/// Largest number of photos for which every pair is matched.
const EXHAUSTIVE: usize = 250;

/// Matching compares each block of photos with each other one, and tells of each pair of blocks; this many blocks, unless they
/// get smaller or larger than COLMAP does well with.
const BLOCKS: usize = 8;
const BLOCK_SIZES: [usize; 2] = [5, 50];

/// Which photos are compared with each other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Matching {
    #[default]
    /// Each with each up to 250 photos, and always where they are no video; else neighbours in time.
    Auto,
    /// Each with each.
    Exhaustive,
    /// Neighbours in the order of their names.
    Sequential,
}

/// What photos come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// Photos, in any order.
    Photos,
    /// Frames of videos, in the order of time.
    Videos,
}

impl Matching {
    /// Resolves `auto` for a number of photos.
    pub fn decided(self, photos: usize, origin: Origin) -> Self {
        match self {
            Self::Auto if origin == Origin::Videos && photos > EXHAUSTIVE => Self::Sequential,
            Self::Auto => Self::Exhaustive,
            decided => decided,
        }
    }
}

/// Which photos share a camera's focal length and distortion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cameras {
    /// All.
    One,
    /// Those of a folder.
    PerFolder,
    /// Those that COLMAP takes for one by their metadata.
    ByMetadata,
}

/// The quality of the result.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Quality {
    /// Photos with a pose in the largest model.
    pub posed: usize,
    /// Models that were found: parts of the scene that share no points.
    pub models: usize,
    /// Points of the largest model.
    pub points: usize,
    /// Mean reprojection error in pixels.
    pub error: f64,
}

/// Folder in the scene for what the mappers need besides.
pub(super) const WORK: &str = "prepare-work";

/// What helps where poses fail.
const MORE_OVERLAP: &str =
    "take them with more overlap (each part of the scene in three or more), in even light and without blur";

/// The program and the folder that it works in.
pub struct Colmap {
    tool: Tool,
    scene: PathBuf,
    has_cuda: bool,
    mappers: Mappers,
}

impl Colmap {
    /// Asks the program for its version and its commands.
    ///
    /// # Errors
    /// It is missing, is no COLMAP, is too old, or does not have the mapper.
    pub fn new(tool: Tool, scene: &Path, mapper: Mapper) -> Result<Self> {
        let help = tool.output(&["-h"])?;
        let Some(version) = version(&help) else { bail!("{} is not COLMAP: its help names no version", tool.name()) };
        let [major, minor] = version;
        if version < OLDEST {
            bail!("{} is COLMAP {major}.{minor}; version {}.{} or newer is needed", tool.name(), OLDEST[0], OLDEST[1]);
        }
        let mappers = Mappers::new(mapper, &tool, &help, version)?;
        Ok(Self { tool, scene: scene.to_owned(), has_cuda: help.contains("with CUDA"), mappers })
    }

    /// Finds features in every photo. Those that the database has are not done again.
    ///
    /// # Errors
    /// As [`Tool::run`].
    pub fn features(&self, model: &str, cameras: Cameras, photos: usize, progress: &dyn Progress) -> Result<()> {
        let mut arguments = arguments!["feature_extractor", "--database_path", self.database()].to_vec();
        arguments.extend(arguments!["--image_path", self.images(), "--ImageReader.camera_model", model]);
        match cameras {
            Cameras::One => arguments.extend(arguments!["--ImageReader.single_camera", "1"]),
            Cameras::PerFolder => arguments.extend(arguments!["--ImageReader.single_camera_per_folder", "1"]),
            Cameras::ByMetadata => {}
        }
        self.add_gpu(&mut arguments, "Extraction.use_gpu")?;
        self.follow(&arguments, ("features", photos), progress, counter(|line| line.contains("Processed file [")))
    }

    /// Matches features between photos. Pairs that the database has are not done again.
    ///
    /// # Errors
    /// As [`Tool::run`].
    pub fn matches(&self, matching: Matching, photos: usize, progress: &dyn Progress) -> Result<()> {
        let command = if matching == Matching::Sequential { "sequential_matcher" } else { "exhaustive_matcher" };
        let mut arguments = arguments![command, "--database_path", self.database()].to_vec();
        self.add_gpu(&mut arguments, "Matching.use_gpu")?;
        let mut steps = photos;
        if matching != Matching::Sequential {
            let size = photos.div_ceil(BLOCKS).clamp(BLOCK_SIZES[0], BLOCK_SIZES[1]);
            arguments.extend(arguments!["--ExhaustiveMatching.block_size", size.to_string()]);
            steps = photos.div_ceil(size).pow(2);
        }
        self.follow(&arguments, ("matching", steps), progress, counter(is_matched))
    }

    /// Gives the largest model the number 0, and measures it.
    ///
    /// # Errors
    /// There is no model.
    pub fn choose(&self) -> Result<Quality> {
        let sparse = self.sparse();
        let models = models(&sparse)?;
        let Some((posed, largest)) = models.iter().max_by_key(|(posed, folder)| (*posed, std::cmp::Reverse(folder)))
        else {
            bail!("COLMAP found no pose for any photo; {MORE_OVERLAP}");
        };
        let first = sparse.join("0");
        if *largest != first {
            let spare = sparse.join("spare");
            let renamed = fs::rename(&first, &spare)
                .and_then(|()| fs::rename(largest, &first))
                .and_then(|()| fs::rename(&spare, largest));
            renamed.with_context(|| format!("cannot rename the models in {}", sparse.display()))?;
        }
        let mut quality = Quality { posed: *posed, models: models.len(), ..Quality::default() };
        self.tool.run(&arguments!["model_analyzer", "--path", &first], |line| {
            if let Some(points) = value(line, "Points: ") {
                quality.points = points as usize;
            }
            if let Some(error) = value(line, "Mean reprojection error: ") {
                quality.error = error;
            }
        })?;
        Ok(quality)
    }

    fn database(&self) -> PathBuf {
        self.scene.join("database.db")
    }

    fn images(&self) -> PathBuf {
        self.scene.join("images")
    }

    fn sparse(&self) -> PathBuf {
        self.scene.join("sparse")
    }

    /// A folder for what is in the way of the result.
    fn work(&self) -> PathBuf {
        self.scene.join(WORK)
    }

    /// The option has another name in each generation, `SiftExtraction.use_gpu` or `FeatureExtraction.use_gpu`.
    fn add_gpu(&self, arguments: &mut Vec<OsString>, end: &str) -> Result<()> {
        let command = arguments[0].to_string_lossy().into_owned();
        let help = self.tool.output(&[&command, "-h"])?;
        let option = help.split_whitespace().find(|word| word.starts_with("--") && word.ends_with(end));
        arguments
            .extend(option.into_iter().flat_map(|option| arguments![option, if self.has_cuda { "1" } else { "0" }]));
        Ok(())
    }

    /// Runs a command; `count` sees its lines and says how many steps are done.
    fn follow(
        &self,
        arguments: &[OsString],
        (what, steps): (&'static str, usize),
        progress: &dyn Progress,
        mut count: impl FnMut(&str) -> usize,
    ) -> Result<()> {
        progress.begin(what, steps);
        let mut done = 0;
        let ran = self.tool.run(arguments, |line| {
            let now = count(line).min(steps);
            (done..now).for_each(|_| progress.step());
            done = done.max(now);
        });
        progress.end();
        ran
    }
}

/// Counts the lines that are a step.
fn counter(is_step: impl Fn(&str) -> bool) -> impl FnMut(&str) -> usize {
    let mut done = 0;
    move |line| {
        done += usize::from(is_step(line));
        done
    }
}

/// Whether matching has come to another photo or pair of blocks: `Matching block [1/2, 1/2]`, later `Processing block [...`.
fn is_matched(line: &str) -> bool {
    ["block [", "image ["].into_iter().any(|what| line.contains(what))
}

/// `3.8` of `COLMAP 3.8 -- Structure-from-Motion ...`.
fn version(help: &str) -> Option<[u32; 2]> {
    let after = help.split("COLMAP ").nth(1)?;
    let mut numbers = after.split(|c: char| !c.is_ascii_digit()).map(|number| number.parse().ok());
    Some([numbers.next()??, numbers.next().flatten().unwrap_or(0)])
}

/// Photos of the model so far, of `Registering image #5 (12)` or `Registering image #5 (num_reg_frames=12)`.
fn registered(line: &str) -> Option<usize> {
    let inner = line.split("Registering image").nth(1)?.split('(').nth(1)?;
    inner.trim_end_matches(')').rsplit('=').next()?.parse().ok()
}

/// The number behind a label, with or without its unit.
fn value(line: &str, label: &str) -> Option<f64> {
    let text = line.split(label).nth(1)?;
    let end = text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len());
    text[..end].parse().ok()
}

/// The models below a folder with their numbers of posed photos.
fn models(sparse: &Path) -> Result<Vec<(usize, PathBuf)>> {
    let entries = fs::read_dir(sparse).with_context(|| format!("cannot read {}", sparse.display()))?;
    let mut models: Vec<_> = entries
        .filter_map(|entry| {
            let folder = entry.ok()?.path();
            let list = fs::read(folder.join("images.bin")).ok()?;
            Some((u64::from_le_bytes(*list.first_chunk()?) as usize, folder))
        })
        .collect();
    models.sort_by(|a, b| a.1.cmp(&b.1));
    Ok(models)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions() {
        assert_eq!(version("COLMAP 3.8 -- Structure-from-Motion and Multi-View Stereo"), Some([3, 8]));
        assert_eq!(version("\nCOLMAP 3.12.0.dev0 -- Structure"), Some([3, 12]));
        assert_eq!(version("COLMAP 4.0"), Some([4, 0]));
        assert_eq!(version("some other program"), None);
    }

    #[test]
    fn what_the_mapper_prints() {
        assert_eq!(registered("Registering image #5 (12)"), Some(12));
        assert_eq!(registered("I20260101 mapper.cc:1] Registering image #5 (num_reg_frames=13)"), Some(13));
        assert_eq!(registered("=> Image sees 812 / 1233 points"), None);
        assert_eq!(value("Mean reprojection error: 0.622px", "Mean reprojection error: "), Some(0.622));
        assert_eq!(value("Points: 5012", "Points: "), Some(5012.0));
    }

    #[test]
    fn what_the_matcher_prints() {
        let lines = [
            "Matching block [1/2, 1/2] in 0.734s",
            "I20260101 12:00:00.5 77 pairing.cc:1] Processing block [1/2, 2/2]",
            "I20260101 12:00:00.5 77 pairing.cc:1] in 0.734s",
            "Matching image [1/12]",
        ];
        let count = counter(is_matched);
        assert_eq!(lines.map(count), [1, 2, 2, 3]);
    }

    #[test]
    fn a_long_video_is_matched_in_order() {
        assert_eq!(Matching::Auto.decided(250, Origin::Videos), Matching::Exhaustive);
        assert_eq!(Matching::Auto.decided(251, Origin::Videos), Matching::Sequential);
        assert_eq!(Matching::Auto.decided(900, Origin::Photos), Matching::Exhaustive);
        assert_eq!(Matching::Sequential.decided(3, Origin::Photos), Matching::Sequential);
    }
}
