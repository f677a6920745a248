//! How a training begins.

use super::{TrainError, Trainer};
use crate::densify::free_space::FreeSpace;
use crate::densify::{self, Statistics};
use crate::exposing::Exposing;
use crate::loss::{ImageLoss, losses};
use crate::optim::Optimizer;
use crate::parameters::Parameters;
use crate::refining::Refining;
use crate::stages::ImageStages;
use crate::telemetry::{Recorder, Telemetry};
use crate::transients::Masking;
use glam::Vec3;
use ibgs_core::camera::{Camera, scene_extent, usable_extent};
use ibgs_core::config::schedule::Schedule;
use ibgs_core::config::{Method, TrainConfig};
use ibgs_core::dataset::{Dataset, Point, median_depth, shown_by_any, unrelated_colors};
use ibgs_core::eval::EvalError;
use ibgs_core::raster::Rasterizer;
use ibgs_core::scene::{Gaussians, from_points};
use ibgs_core::sources::source_store::SourceStore;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::VecDeque;
use std::sync::Arc;

/// A training begins with so many Gaussians that some camera shows, or with one of a hundred.
const LEAST_SHOWN: usize = 100;

/// Points that the distance of what a view shows is measured by.
const MOST_LOOKED_AT: usize = 20_000;

/// At most `most` points, evenly taken from the list.
fn thinned(points: &[Point], most: usize) -> Cow<'_, [Point]> {
    if points.len() <= most {
        return Cow::Borrowed(points);
    }
    (0..most).map(|i| points[i * points.len() / most]).collect()
}

/// Lengths of the scene in local units.
struct Lengths {
    extent: f64,
    /// What the pruning by scale measures by.
    prune_length: f64,
}

impl Lengths {
    /// Of a data set with the cameras of its training views, in the scene's coordinates, and the first Gaussians, in local ones.
    fn new(dataset: &Dataset, scene_cameras: &[Camera], config: &TrainConfig, start: &Gaussians) -> Self {
        let space = &start.space;
        let (centre, extent) = scene_extent(scene_cameras.iter());
        let extent = usable_extent(dataset.extent.unwrap_or(extent) / space.scale);
        let prune_length = match config.densify.prune_scale_by_distance {
            true => densify::distance_length(&start.means, space.to_local(centre), extent),
            false => extent,
        };
        Self { extent, prune_length }
    }
}

/// The median depth of the points that each camera shows, in local units; the scene's extent where it shows none.
fn lengths_of(cameras: &[Camera], dataset: &Dataset, extent: f64) -> Vec<f64> {
    let space = dataset.space();
    let points: Vec<_> = thinned(&dataset.points, MOST_LOOKED_AT).iter().map(|p| space.to_local(p.position)).collect();
    cameras.par_iter().map(|camera| median_depth(camera, &points).unwrap_or(extent)).collect()
}

impl Trainer {
    /// Uploads the training photos and makes the first Gaussians from the data set's points.
    ///
    /// # Errors
    /// Not enough memory, no training view, points that are no positions.
    pub fn new(raster: Arc<Rasterizer>, dataset: &Dataset, config: &TrainConfig) -> Result<Self, TrainError> {
        let points = thinned(&dataset.points, config.densify.most() as usize);
        let [opacity, scale] = config.start();
        let space = dataset.space();
        let points: Vec<Point> = points.iter().map(|point| point.to_local(&space)).collect();
        if let Some(warning) = unrelated_colors(dataset).map_err(EvalError::from)? {
            log::warn!("{warning}");
        }
        let mut start = from_points(&points, config.sh_degree(), opacity)?;
        start.space = space;
        start.log_scales.as_flattened_mut().iter_mut().for_each(|s| *s += scale.ln() as f32);
        Self::counted(raster, dataset, config, (&start, "points"))
    }

    /// Uploads the training photos and begins with the given Gaussians, in any space; their spherical harmonics keep their
    /// degree.
    ///
    /// # Errors
    /// Not enough memory, no training view.
    pub fn from_gaussians(
        raster: Arc<Rasterizer>,
        dataset: &Dataset,
        config: &TrainConfig,
        start: &Gaussians,
    ) -> Result<Self, TrainError> {
        Self::counted(raster, dataset, config, (start, "Gaussians"))
    }

    /// The same; `what` names what the Gaussians were made of.
    fn counted(
        raster: Arc<Rasterizer>,
        dataset: &Dataset,
        config: &TrainConfig,
        (start, what): (&Gaussians, &'static str),
    ) -> Result<Self, TrainError> {
        let trainer = Self::with_default_room(raster, (dataset, dataset.checksum()), config, start)?;
        let local = start.in_space(dataset.space());
        let places = local.means.par_iter().map(|&mean| Vec3::from(mean).as_dvec3());
        let (shown, all) = (shown_by_any(&trainer.cameras, places), local.len());
        if shown < LEAST_SHOWN && 100 * shown < all {
            return Err(TrainError::Unseen { shown, all, what });
        }
        // Count the intersections of every view exactly, once; the room then grows with the counts that the telemetry
        // reports. The first Gaussians grow fast.
        let mut most = 0;
        for index in 0..trainer.cameras.len() {
            most = most.max(trainer.raster.count_intersections(trainer.splats(), &trainer.view(index))?);
        }
        trainer.raster.reserve(2 * most);
        Ok(trainer)
    }

    /// The same without counting the intersections, with all members of the ensemble; the data set comes with its checksum.
    pub(super) fn with_default_room(
        raster: Arc<Rasterizer>,
        scene: (&Dataset, u32),
        config: &TrainConfig,
        start: &Gaussians,
    ) -> Result<Self, TrainError> {
        let mut first = Self::single(raster.clone(), scene, (config, start), None)?;
        for number in 2..=config.ensemble() {
            let config = config.of_member(number);
            let start = start.with_sh_degree(config.sh_degree());
            let photos = Some(first.photos.clone());
            first.members.push(Self::single(raster.clone(), scene, (&config, &start), photos)?);
        }
        Ok(first)
    }

    /// A member, with the photos of the first where there are some.
    fn single(
        raster: Arc<Rasterizer>,
        (dataset, scene): (&Dataset, u32),
        (config, start): (&TrainConfig, &Gaussians),
        photos: Option<Arc<SourceStore>>,
    ) -> Result<Self, TrainError> {
        let gpu = raster.gpu().clone();
        if dataset.train.is_empty() {
            return Err(TrainError::NoViews);
        }
        let space = dataset.space();
        let start = start.in_space(space);
        let parameters = Parameters::upload(&start, &gpu)?;
        let splats = parameters.splats();
        let views = || dataset.train.iter().map(|&i| &dataset.views[i]);
        let scene_cameras: Arc<[Camera]> = views().map(|view| view.camera).collect();
        let cameras: Arc<[Camera]> = scene_cameras.iter().map(|camera| space.camera(camera)).collect();
        let photos = match photos {
            Some(photos) => photos,
            None => {
                let photos = views().map(|view| view.photo.clone()).collect();
                Arc::new(SourceStore::new(gpu.clone(), photos, gpu.bytes_of(config.sources.memory))?)
            }
        };
        let image_based = config.method == Method::Ibgs;
        let stages = image_based.then(|| ImageStages::new(&gpu, [&scene_cameras, &cameras], config)).transpose()?;
        let Lengths { extent, prune_length } = Lengths::new(dataset, &scene_cameras, config, &start);
        let strategy = densify::strategy(config.densify.strategy);
        let part = strategy.free_space(&config.densify);
        let free_space = FreeSpace::new(&cameras, (&dataset.points, &space), part);
        Ok(Self {
            losses: losses(&gpu, config),
            loss: ImageLoss::new(gpu.clone(), config.ssim_weight as f32),
            schedule: Schedule::new(config, config.iterations()),
            optimizer: Optimizer::new(&gpu, splats, config.adam.clone(), config.method)?,
            statistics: Statistics::new(&gpu, splats.len())?,
            exposing: Exposing::new(&gpu, cameras.len(), &config.exposure)?,
            refining: Refining::new(&gpu, (&cameras, space), || lengths_of(&cameras, dataset, extent), config)?,
            masking: Masking::new(&gpu, &cameras, config)?,
            recorder: Recorder::new(&gpu)?,
            telemetry: Telemetry::default(),
            queue: Vec::new(),
            extent,
            prune_length,
            strategy,
            free_space,
            rng: ChaCha8Rng::seed_from_u64(config.seed),
            iteration: 0,
            overflowed: false,
            scene,
            caution: 1.0,
            is_whole: true,
            in_flight: VecDeque::new(),
            members: Vec::new(),
            config: config.clone(),
            gpu,
            raster,
            parameters,
            cameras,
            scene_cameras,
            photos,
            stages,
            has_planes: start.offsets.iter().any(|&offset| offset != 0.0),
        })
    }
}
