//! What a scene is made of and how far it is, in a file of the scene.

use super::colmap::{Mapper, Matching};
use anyhow::{Context, Result};
use ibgs_core::files::is_same;
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::{Path, PathBuf};

/// File in the scene that records its inputs and the finished steps.
const RECORD: &str = "prepare.json";

/// What a scene is made of.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Request {
    /// Folders of photos and videos.
    pub inputs: Vec<PathBuf>,
    /// Most frames of a video.
    pub frames: usize,
    /// COLMAP's camera model.
    pub camera_model: String,
    /// Which photos are compared with each other.
    pub matching: Matching,
    /// What estimates the poses.
    #[serde(default)]
    pub mapper: Mapper,
}

impl Request {
    /// Whether it asks for the same, by other paths or not.
    fn is_same(&self, other: &Self) -> bool {
        let Self { inputs, frames, camera_model, matching, mapper } = other;
        (self.frames, &self.camera_model, self.matching, self.mapper) == (*frames, camera_model, *matching, *mapper)
            && self.has_same_inputs(inputs)
    }

    fn has_same_inputs(&self, inputs: &[PathBuf]) -> bool {
        self.inputs.len() == inputs.len() && self.inputs.iter().zip(inputs).all(|(a, b)| is_same(a, b))
    }
}

/// How much the inputs hold: photos that are added or removed change it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Contents {
    files: usize,
    bytes: u64,
}

impl Contents {
    /// What the files of all inputs hold.
    pub fn of(photos: &[Vec<PathBuf>]) -> Self {
        let bytes = |path: &PathBuf| Some(fs::metadata(path).ok()?.len());
        Self { files: photos.iter().map(Vec::len).sum(), bytes: photos.iter().flatten().filter_map(bytes).sum() }
    }
}

/// Where a scene stands.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Record {
    pub request: Request,
    contents: Contents,
    /// The last step that is done.
    pub done: Step,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Step {
    Nothing,
    Photos,
    Features,
    Matches,
    Poses,
}

impl Record {
    pub fn new(request: Request, contents: Contents) -> Self {
        Self { request, contents, done: Step::Nothing }
    }

    /// What an earlier preparation left in a folder; none where there was none.
    pub fn read(scene: &Path) -> Result<Option<Self>> {
        let path = scene.join(RECORD);
        if !path.exists() {
            return Ok(None);
        }
        let text = fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
        let record = serde_json::from_str(&text);
        record.map(Some).with_context(|| format!("{} is damaged; remove it, or choose another folder", path.display()))
    }

    pub fn save(&self, scene: &Path) -> Result<()> {
        let path = scene.join(RECORD);
        let text = serde_json::to_string_pretty(self).context("cannot describe the scene")?;
        fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))
    }

    /// Whether it was made of the same files with the same options.
    pub fn continues(&self, new: &Self) -> bool {
        self.request.is_same(&new.request) && self.contents == new.contents
    }

    /// Whether the poses are there and the files are the same, with whatever options.
    pub fn is_complete(&self, inputs: &[PathBuf], contents: Contents) -> bool {
        self.done == Step::Poses && self.request.has_same_inputs(inputs) && self.contents == contents
    }
}
