//! The plan of a scene's blocks, and its folder.

use super::Core;
use crate::config::{ConfigError, TrainConfig};
use crate::files::WriteError;
use crate::output::cameras::{CameraRecord, to_json};
use crate::output::write_json;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Number of the format.
const FORMAT: u32 = 1;
/// File of the plan in its folder.
const FILE: &str = "plan.json";

/// A block: its part of space, and the photos that it is trained and measured on.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Block {
    /// Where its Gaussians are kept.
    pub core: Core,
    /// Number of the scene's points in the core.
    pub points: usize,
    /// Number of points that its training photos show: so many Gaussians it begins with.
    pub start_points: usize,
    /// Names of its training photos.
    pub train: Vec<String>,
    /// Names of the held-out photos that show it.
    pub test: Vec<String>,
    /// Most Gaussians that its training makes.
    pub gaussians: u64,
    /// Number of iterations of its training.
    pub iterations: u32,
    /// Device memory that its training needs at that number of Gaussians, estimated, in bytes.
    pub memory: u64,
    /// Minutes of its training on an NVIDIA H100, roughly estimated.
    pub minutes: f64,
}

/// The blocks of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BlockPlan {
    /// They are numbered from 0.
    pub blocks: Vec<Block>,
    /// Device memory that a training may take, in bytes; none: as is there.
    pub memory_limit: Option<u64>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PlanFile {
    format: u32,
    memory_limit: Option<u64>,
    blocks: Vec<Block>,
}

/// Why a scene cannot be cut, or a plan not be used.
#[derive(Debug, Error)]
pub enum PlanError {
    /// The scene has too few points.
    #[error(
        "the scene has {points} points, too few for {blocks} blocks; cut it into fewer, or use a model with more points"
    )]
    Points {
        /// Number of points.
        points: usize,
        /// Number of blocks.
        blocks: usize,
    },
    /// A block has too few photos.
    #[error("block {block} of {blocks} would have {photos} training photos; cut the scene into fewer blocks")]
    Photos {
        /// Number of the block.
        block: usize,
        /// Number of its training photos.
        photos: usize,
        /// Number of blocks.
        blocks: usize,
    },
    /// The folder holds no plan.
    #[error("{} is no plan of blocks: it has no plan.json", path.display())]
    NoPlan {
        /// The folder.
        path: PathBuf,
    },
    /// A file cannot be read.
    #[error("cannot read {}: {reason}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The reason.
        reason: String,
    },
    /// The plan has no such block.
    #[error("{} has no block {block}: its blocks have the numbers 0 to {last}", path.display())]
    NoBlock {
        /// The folder.
        path: PathBuf,
        /// The number asked for.
        block: u32,
        /// The largest number.
        last: usize,
    },
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// The options cannot be read or written.
    #[error(transparent)]
    Config(#[from] ConfigError),
}

impl BlockPlan {
    /// Reads the contents of `plan.json`; `path` is for messages.
    ///
    /// # Errors
    /// [`PlanError::Read`] with line and column.
    pub fn from_json(bytes: &[u8], path: &Path) -> Result<Self, PlanError> {
        let file: PlanFile = serde_json::from_slice(bytes).map_err(|error| unreadable(path, error))?;
        match file {
            PlanFile { format: FORMAT, memory_limit, blocks } if !blocks.is_empty() => {
                Ok(Self { blocks, memory_limit })
            }
            PlanFile { format: FORMAT, .. } => Err(unreadable(path, "it has no blocks")),
            PlanFile { format, .. } => {
                Err(unreadable(path, format!("its format {format} is not {FORMAT}, that of this version")))
            }
        }
    }

    /// Whether a photo was held out.
    pub fn holds_out(&self) -> bool {
        self.blocks.iter().any(|block| !block.test.is_empty())
    }
}

fn unreadable(path: &Path, reason: impl ToString) -> PlanError {
    PlanError::Read { path: path.to_owned(), reason: reason.to_string() }
}

/// The folder of a plan.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlanFolder {
    root: PathBuf,
}

impl PlanFolder {
    /// The folder of a plan, whether it is there or not.
    pub fn at(path: &Path) -> Self {
        Self { root: path.to_owned() }
    }

    /// Whether a plan was written there.
    pub fn holds_plan(&self) -> bool {
        self.root.join(FILE).is_file()
    }

    /// The folder itself.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Options of all trainings.
    pub fn config_path(&self) -> PathBuf {
        self.root.join("options.toml")
    }

    /// Cameras that were adjusted before the blocks; there is no such file where they are the scene's.
    pub fn cameras_path(&self) -> PathBuf {
        self.root.join("cameras.json")
    }

    /// Names of a block's photos.
    pub fn split_path(&self, block: u32) -> PathBuf {
        self.root.join("blocks").join(format!("{block}.json"))
    }

    /// Model folder of a block.
    pub fn block_path(&self, block: u32) -> PathBuf {
        self.root.join("blocks").join(block.to_string())
    }

    /// The joined Gaussians.
    pub fn joined_path(&self) -> PathBuf {
        self.root.join("joined.ply")
    }

    /// Model folder of the whole, unless another one is named.
    pub fn model_path(&self) -> PathBuf {
        self.root.join("model")
    }

    /// Writes the cameras that all blocks have, before the plan itself.
    ///
    /// # Errors
    /// [`PlanError::Write`].
    pub fn write_cameras(&self, cameras: &[CameraRecord]) -> Result<(), PlanError> {
        Ok(write_json(&self.cameras_path(), &to_json(cameras))?)
    }

    /// Writes a plan, and the options that its trainings have in common.
    ///
    /// # Errors
    /// [`PlanError::Write`], [`PlanError::Config`]; the plan itself comes last.
    pub fn write(&self, plan: &BlockPlan, config: &TrainConfig) -> Result<(), PlanError> {
        config.save(&self.config_path())?;
        for (number, Block { train, test, .. }) in (0..).zip(&plan.blocks) {
            let names = json!({ "train": train, "test": test });
            write_json(&self.split_path(number), &names)?;
        }
        let BlockPlan { blocks, memory_limit } = plan.clone();
        let file = PlanFile { format: FORMAT, memory_limit, blocks };
        Ok(write_json(&self.root.join(FILE), &file)?)
    }

    /// Reads the plan.
    ///
    /// # Errors
    /// [`PlanError::NoPlan`], [`PlanError::Read`] with line and column.
    pub fn read(&self) -> Result<BlockPlan, PlanError> {
        let path = self.root.join(FILE);
        if !path.is_file() {
            return Err(PlanError::NoPlan { path: self.root.clone() });
        }
        let bytes = std::fs::read(&path).map_err(|error| unreadable(&path, error))?;
        BlockPlan::from_json(&bytes, &path)
    }

    /// Reads the options of the trainings, for a block of a plan.
    ///
    /// # Errors
    /// [`PlanError::NoBlock`], [`PlanError::Config`], [`PlanError::Read`] where the working directory is gone.
    pub fn block_config(&self, plan: &BlockPlan, block: u32) -> Result<TrainConfig, PlanError> {
        if block as usize >= plan.blocks.len() {
            let last = plan.blocks.len().saturating_sub(1);
            return Err(PlanError::NoBlock { path: self.root.clone(), block, last });
        }
        let mut config = self.config()?;
        config.data.split = Some(self.absolute(&self.split_path(block))?);
        Ok(config)
    }

    /// Reads the options of the trainings.
    ///
    /// # Errors
    /// [`PlanError::Config`], [`PlanError::Read`] where the working directory is gone.
    pub fn config(&self) -> Result<TrainConfig, PlanError> {
        let mut config = TrainConfig::load(&self.config_path())?;
        if self.cameras_path().is_file() {
            config.poses.cameras = Some(self.absolute(&self.cameras_path())?);
        }
        Ok(config)
    }

    fn absolute(&self, path: &Path) -> Result<PathBuf, PlanError> {
        std::path::absolute(path).map_err(|error| unreadable(&self.root, error))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plan_is_read_as_written_and_damage_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let plan_folder = PlanFolder::at(folder.path());
        let error = |wanted: &str| {
            let found = plan_folder.read().unwrap_err().to_string();
            assert!(found.contains(wanted), "{found}");
        };
        error("has no plan.json");
        let core = Core { min: [Some(0.1), None, Some(-3.5)], max: [None; 3] };
        let block = Block { core, train: vec!["a.png".into()], memory: 7, minutes: 1.5, ..Block::default() };
        let plan = BlockPlan { blocks: vec![Block::default(), block], memory_limit: Some(8 << 30) };
        let mut config = TrainConfig { source: Some("scene".into()), ..TrainConfig::default() };
        plan_folder.write(&plan, &config).unwrap();
        assert_eq!(plan_folder.read().unwrap(), plan);
        let split = std::fs::read_to_string(plan_folder.split_path(1)).unwrap();
        assert!(split.contains("a.png"), "{split}");
        config.data.split = Some(std::path::absolute(plan_folder.split_path(1)).unwrap());
        assert_eq!(plan_folder.block_config(&plan, 1).unwrap(), config);
        let last = plan_folder.block_config(&plan, 2).unwrap_err().to_string();
        assert!(last.contains("0 to 1"), "{last}");
        for (text, wanted) in [
            ("{\"format\": 2, \"blocks\": []}", "format 2"),
            ("{\"format\": 1, \"blocks\": []}", "no blocks"),
            ("{\"format\": 1, \"blocks\": [{}]}", "missing field"),
            ("{", "line 1"),
        ] {
            std::fs::write(folder.path().join(FILE), text).unwrap();
            error(wanted);
        }
    }
}
