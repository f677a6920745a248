//! What a training needs of the device's memory, and how many Gaussians fit into what there is.

use super::{Demand, Estimate, INTERSECTIONS};
use crate::Trainer;
use ibgs_core::camera::Camera;
use ibgs_core::config::TrainConfig;
use ibgs_core::dataset::Dataset;
use ibgs_core::gpu::{Bytes, Gpu};
use ibgs_core::raster::Rasterizer;
use ibgs_core::sources::memory::{AUTO_OF_CARDS, MemoryBudget};
use std::fmt;

/// Share of the free device memory that `auto` may use; other programs and the driver need some.
const PART: f64 = 0.9;

/// A training needs more device memory than there is, however few Gaussians it is limited to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the training needs about {} of device memory at {} Gaussians, and {} is there",
    Bytes(needed.bytes),
    needed.gaussians,
    Bytes(*budget)
)]
pub struct DoesNotFit {
    /// What it needs at its start.
    pub needed: Need,
    /// Bytes that there are.
    pub budget: u64,
    /// It begins with a trained network, as merged blocks do.
    pub has_network: bool,
}

/// Fewer Gaussians than the options allow, because more do not fit into the memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemoryLimit {
    /// What the most Gaussians of the options would need.
    pub wanted: Need,
    /// Bytes that there are.
    pub budget: u64,
    /// Gaussians that fit.
    pub fits: u32,
}

impl fmt::Display for MemoryLimit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { wanted: Need { gaussians, bytes }, budget, fits } = *self;
        let (bytes, budget) = (Bytes(bytes), Bytes(budget));
        write!(
            f,
            "{gaussians} Gaussians would need {bytes} of device memory, and {budget} is there: their number stops at {fits}"
        )
    }
}

/// Bytes of device memory that a number of Gaussians needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Need {
    /// Number of Gaussians.
    pub gaussians: u64,
    /// Bytes, about.
    pub bytes: u64,
}

/// Estimates the memory that a training needs, by the number of Gaussians.
pub struct Needs {
    config: TrainConfig,
    cameras: Vec<Camera>,
    gaussians: u64,
    most: u64,
    sh_degree: u32,
    room: u64,
    photo_budget: Option<u64>,
    evaluates: bool,
}

impl Needs {
    /// For a training at its start.
    pub fn of(trainer: &Trainer, raster: &Rasterizer, dataset: &Dataset, config: &TrainConfig) -> Self {
        Self {
            config: config.clone(),
            cameras: dataset.train.iter().map(|&index| dataset.views[index].camera).collect(),
            gaussians: trainer.splats().len() as u64,
            most: config.densify.most().into(),
            sh_degree: trainer.splats().sh_degree(),
            room: raster.capacity(),
            photo_budget: raster.gpu().bytes_of(config.sources.memory),
            evaluates: !dataset.test.is_empty(),
        }
    }

    /// For a training that is planned, from this number of points on; its options know the photos already.
    pub fn planned(config: &TrainConfig, cameras: Vec<Camera>, points: usize, evaluates: bool) -> Self {
        let gaussians = points as u64;
        Self {
            config: config.clone(),
            cameras,
            gaussians,
            most: u64::from(config.densify.most()).max(gaussians),
            sh_degree: config.sh_degree(),
            // As a training finds that its Gaussians meet many tiles.
            room: 4 * INTERSECTIONS * gaussians,
            photo_budget: match config.sources.memory {
                MemoryBudget::Bytes(bytes) => Some(bytes),
                MemoryBudget::Auto => Some(AUTO_OF_CARDS),
                MemoryBudget::Unlimited => None,
            },
            evaluates,
        }
    }

    /// What is needed at the start.
    pub fn at_start(&self) -> Need {
        self.at(self.gaussians)
    }

    /// What is needed with the most Gaussians.
    pub fn at_most(&self) -> Need {
        self.at(self.most)
    }

    /// [`Needs::at_most`] within a budget: with fewer Gaussians where that is needed. None where it does not even begin.
    pub fn within(&self, budget: u64) -> Option<Need> {
        self.fitting(budget).map(|most| self.at(most))
    }

    fn at(&self, gaussians: u64) -> Need {
        Need { gaussians, bytes: self.bytes(gaussians) }
    }

    /// The largest number of Gaussians, up to the cap of the options, that fits into a budget; none if the initial ones do not.
    fn fitting(&self, budget: u64) -> Option<u64> {
        if self.bytes(self.gaussians) > budget {
            return None;
        }
        if !self.grows() || self.bytes(self.most) <= budget {
            return Some(self.most);
        }
        let (mut fits, mut too_many) = (self.gaussians, self.most);
        while too_many - fits > 1 {
            let middle = (fits + too_many) / 2;
            if self.bytes(middle) <= budget { fits = middle } else { too_many = middle }
        }
        Some(fits)
    }

    /// Whether Gaussians may still be added.
    pub fn grows(&self) -> bool {
        self.config.init.is_none() && self.gaussians < self.most
    }

    /// Bytes needed at this number of Gaussians.
    fn bytes(&self, gaussians: u64) -> u64 {
        let now = Demand {
            config: &self.config,
            sh_degree: self.sh_degree,
            cameras: &self.cameras,
            gaussians: self.gaussians,
            room: self.room,
            photo_budget: self.photo_budget,
            grows: self.grows(),
            evaluates: self.evaluates,
        };
        let demand = if gaussians > self.gaussians { now.grown_to(gaussians) } else { now };
        Estimate::new(&demand).total()
    }

    /// Limits the Gaussians to those that fit into the budget; none if as many fit as the options allow.
    ///
    /// # Errors
    /// The initial Gaussians do not fit.
    pub fn limit(&mut self, budget: MemoryBudget, gpu: &Gpu) -> Result<Option<MemoryLimit>, DoesNotFit> {
        let budget = match budget {
            MemoryBudget::Auto => gpu.memory_bytes().map(|bytes| (PART * bytes as f64) as u64),
            MemoryBudget::Unlimited => None,
            MemoryBudget::Bytes(bytes) => Some(bytes),
        };
        let Some(budget) = budget else { return Ok(None) };
        let Some(fits) = self.fitting(budget) else {
            let has_network = self.config.residual.init.is_some();
            return Err(DoesNotFit { needed: self.at_start(), budget, has_network });
        };
        if fits >= self.most {
            return Ok(None);
        }
        let wanted = self.at_most();
        self.most = fits;
        // The options' own cap, which is larger, has 32 bits.
        let fits = u32::try_from(fits).unwrap_or(u32::MAX);
        Ok(Some(MemoryLimit { wanted, budget, fits }))
    }
}
