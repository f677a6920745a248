//! Short trainings of the base alone on reduced photos, some of which are left out: what decides options that say `auto`.

use crate::step::{TrainError, Trainer};
use ibgs_core::config::{Method, TrainConfig};
use ibgs_core::dataset::{Dataset, thinned};
use ibgs_core::eval::EvalError;
use ibgs_core::raster::Rasterizer;
use std::sync::Arc;

/// Iterations of a training.
const ITERATIONS: u32 = 1_500;
/// Shorter runs are not worth a trial.
const SHORTEST_RUN: u32 = 2 * ITERATIONS;
/// Longest side of the photos, in pixels.
const LONGEST: u32 = 480;
/// Most points to begin with.
const MOST_POINTS: usize = 30_000;
/// Fewer training photos say nothing.
const LEAST_PHOTOS: usize = 8;
/// Most Gaussians.
const MOST_SPLATS: u32 = 150_000;

/// A scene's training photos, reduced, and the options of trainings on a part of them.
pub struct Trial {
    raster: Arc<Rasterizer>,
    /// Its held-out views are those that the trainings leave out.
    pub small: Dataset,
    config: TrainConfig,
}

impl Trial {
    /// Whether a training is worth one: not in short runs, with few photos, from a finished model, or on a software adapter, where
    /// it would take minutes.
    pub fn is_worth_it(raster: &Rasterizer, dataset: &Dataset, config: &TrainConfig) -> bool {
        let is_long = config.iterations() >= SHORTEST_RUN && !raster.gpu().is_software();
        is_long && dataset.train.len() >= LEAST_PHOTOS && config.init.is_none()
    }

    /// Leaves one of `every` training photos out.
    pub fn new(
        raster: &Arc<Rasterizer>,
        dataset: &Dataset,
        config: &TrainConfig,
        every: usize,
    ) -> Result<Self, TrainError> {
        let mut small = dataset.reduced(&dataset.train, LONGEST).map_err(EvalError::from)?;
        (small.test, small.train) = (0..small.views.len()).partition(|view| view % every == every / 2);
        small.points = thinned(&small.points, MOST_POINTS);
        Ok(Self { raster: raster.clone(), small, config: short(config, dataset) })
    }

    /// A whole training, with changed options.
    pub fn trained(&self, change: impl FnOnce(&mut TrainConfig)) -> Result<(Trainer, TrainConfig), TrainError> {
        let mut config = self.config.clone();
        change(&mut config);
        config.adapt_to(&self.small);
        let mut trainer = Trainer::new(self.raster.clone(), &self.small, &config)?;
        for _ in 0..config.iterations() {
            trainer.step()?;
        }
        Ok((trainer, config))
    }
}

/// The options of a trial.
fn short(config: &TrainConfig, dataset: &Dataset) -> TrainConfig {
    let mut short = TrainConfig {
        method: Method::Gs3,
        iterations: Some(ITERATIONS),
        schedule_scaling: true,
        seed: config.seed,
        background: config.background,
        data: config.data.clone(),
        ..TrainConfig::default()
    };
    short.densify.max_splats = Some(MOST_SPLATS.min(config.densify.most()));
    // The built-in scene alone has none.
    short.source.get_or_insert_with(|| dataset.path.clone());
    short
}
