//! Estimates the device memory that a training needs, before it begins.

use crate::stderr;
use anyhow::Result;
use ibgs_core::camera::Camera;
use ibgs_core::config::TrainConfig;
use ibgs_core::dataset::Dataset;
use ibgs_core::gpu::Bytes;
use ibgs_core::gpu::Gpu;
use ibgs_core::raster::Rasterizer;
use ibgs_core::sources::memory::MemoryBudget;
use ibgs_train::Trainer;
use ibgs_train::memory::{Demand, Estimate, INTERSECTIONS};

/// Share of the free device memory that `auto` may use; other programs and the driver need some.
const PART: f64 = 0.9;

/// A training needs more device memory than there is.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct DoesNotFit(String);

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
            photo_budget: config.sources.memory.bytes(raster.gpu()),
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
                MemoryBudget::Auto => Some(MemoryBudget::AUTO_OF_CARDS),
                MemoryBudget::Unlimited => None,
            },
            evaluates,
        }
    }

    /// Most Gaussians of the training, and the bytes that it needs with them.
    pub fn most(&self) -> (u64, u64) {
        (self.most, self.bytes(self.most))
    }

    /// Bytes needed at the start.
    pub fn least(&self) -> u64 {
        self.bytes(self.gaussians)
    }

    /// [`Needs::most`] within a budget: with fewer Gaussians where that is needed. None where it does not even begin.
    pub fn within(&self, budget: u64) -> Option<(u64, u64)> {
        let most = self.fitting(budget)?;
        Some((most, self.bytes(most)))
    }

    /// The largest number of Gaussians, up to the cap of the options, that fits into a budget; none if the initial ones do not.
    fn fitting(&self, budget: u64) -> Option<u64> {
        if self.least() > budget {
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

    fn grows(&self) -> bool {
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

    /// The largest number of Gaussians that fits into the budget; none if the cap of the options fits.
    ///
    /// # Errors
    /// The initial Gaussians do not fit.
    pub fn limit(&mut self, budget: MemoryBudget, gpu: &Gpu) -> Result<Option<u32>> {
        let budget = match budget {
            MemoryBudget::Auto => gpu.memory_bytes().map(|bytes| (PART * bytes as f64) as u64),
            MemoryBudget::Unlimited => None,
            MemoryBudget::Bytes(bytes) => Some(bytes),
        };
        let Some(budget) = budget else { return Ok(None) };
        let Some(fits) = self.fitting(budget) else {
            let advice = match self.config.residual.init {
                // A merge, whose photos and Gaussians are what they are.
                Some(_) => "`ibgs merge --iterations 0` does without it",
                None => {
                    "train on smaller photos (`--resolution`), give the source photos less (`--source-memory`), or cut the scene \
                     into more blocks (`ibgs split`)"
                }
            };
            let text = format!(
                "the training needs about {} of device memory at {} Gaussians, and {} is there (`--gpu-memory`); {advice}",
                Bytes(self.least()),
                self.gaussians,
                Bytes(budget)
            );
            return Err(DoesNotFit(text).into());
        };
        if fits >= self.most {
            return Ok(None);
        }
        stderr!(
            "warning: {} Gaussians would need {} of device memory, and {} is there (`--gpu-memory`): their number stops at {fits}",
            self.most,
            Bytes(self.bytes(self.most)),
            Bytes(budget)
        );
        self.most = fits;
        Ok(Some(u32::try_from(fits)?))
    }

    /// `memory: needs about 310 MiB at 5000 Gaussians, 1.2 GiB at 1000000 (--max-splats)`.
    pub fn sentence(&self) -> String {
        let mut text = format!("memory: needs about {} at {} Gaussians", Bytes(self.least()), self.gaussians);
        if self.grows() {
            text += &format!(", {} at {} (`--max-splats`)", Bytes(self.bytes(self.most)), self.most);
        }
        text
    }
}
