//! The image-based part of a training iteration (method.md section 7): the photos of neighbouring views warped to the view, and
//! the residual network.

use super::checkpoint::NetworkState;
use super::optim::TensorOptimizer;
use super::step::TrainError;
use crate::autodiff;
use crate::loss::WarpedSources;
use crate::parameters::NetworkParameters;
use crate::tensor::primitive;
use burn::tensor::{Gradients, Tensor};
use ibgs_core::camera::Camera;
use ibgs_core::config::schedule::Schedule;
use ibgs_core::config::{AdamConfig, AdamMoments, ResidualConfig, TrainConfig};
use ibgs_core::exposure::Exposures;
use ibgs_core::gpu::{Buffer, Gpu, GpuError, Pass};
use ibgs_core::raster::{Forward, RasterView, Rasterizer, Room};
use ibgs_core::render::{ImageOptions, ImagePart};
use ibgs_core::residual::layers::WEIGHTS;
use ibgs_core::residual::weights::NetworkError;
use ibgs_core::residual::{Residual, ResidualTask};
use ibgs_core::scene::Splats;
use ibgs_core::sources::depth_cache::DepthCache;
use ibgs_core::sources::find::{Draw, SourceFinder};
use ibgs_core::sources::source_store::SourceStore;
use ibgs_core::sources::{SourceView, Warped, Warper};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

/// What the image-based stages keep from iteration to iteration.
pub(super) struct ImageStages {
    gpu: Arc<Gpu>,
    /// In local coordinates.
    cameras: Arc<[Camera]>,
    options: ImageOptions,
    /// Candidates for the sources of each training view, best first.
    neighbours: Vec<Vec<usize>>,
    seed: u64,
    /// Median depth of each training view when it was last trained.
    depths: DepthCache,
    warper: Warper,
    residual: Residual,
    config: ResidualConfig,
    network: NetworkParameters,
    network_optimizer: TensorOptimizer,
}

/// An iteration in progress: the view and the rasterizer's pass.
pub(super) struct Work<'a> {
    pub iteration: u32,
    /// Training view.
    pub index: usize,
    pub image: &'a Tensor<3>,
    /// The image in the photo's exposure.
    pub shown: &'a Tensor<3>,
    /// Exposures of photo and sources, where they are corrected.
    pub exposures: Option<&'a Exposures>,
    /// The view's sources.
    pub sources: &'a [usize],
    /// A loss reads them.
    pub warps: bool,
    pub forward: &'a Forward,
    pub schedule: &'a Schedule,
    pub photos: &'a SourceStore,
    pub raster: &'a Rasterizer,
    pub splats: &'a Splats,
}

/// What the sources give an iteration.
#[derive(Default)]
pub(super) struct FromSources {
    pub warped: Option<WarpedSources>,
    pub final_image: Option<FinalImage>,
}

/// The final image of an iteration, or of a band of its rows.
pub(super) struct FinalImage {
    pub image: Tensor<3>,
    /// Its rows of the view; none: all.
    pub rows: Option<Range<u32>>,
    /// The network's weights as a leaf.
    pub network: Tensor<1>,
}

impl ImageStages {
    /// For the training views, whose cameras come in the scene's and in local coordinates.
    pub fn new(gpu: &Arc<Gpu>, cameras: [&Arc<[Camera]>; 2], config: &TrainConfig) -> Result<Self, GpuError> {
        let [scene_cameras, cameras] = cameras;
        let options = config.image_options();
        let finder = SourceFinder::new(scene_cameras, &options.sources);
        let candidates = |(index, camera): (usize, &Camera)| finder.neighbours(camera, Some(index));
        let network = NetworkParameters::init(gpu, &options.variant, config.seed)?;
        let residual = &config.residual;
        let (beta1, beta2, epsilon) = (residual.beta1, residual.beta2, residual.epsilon);
        let adam = AdamConfig { beta1, beta2, epsilon, moments: AdamMoments::Full };
        Ok(Self {
            neighbours: scene_cameras.iter().enumerate().map(candidates).collect(),
            seed: config.seed,
            depths: DepthCache::new(gpu.bytes_of(config.surface.depth_memory)),
            warper: Warper::new(gpu.clone(), options.warp()),
            residual: Residual::new(gpu.clone(), options.variant, options.precision),
            network_optimizer: TensorOptimizer::new(gpu, &network.network().weights, WEIGHTS, adam)?,
            gpu: gpu.clone(),
            config: residual.clone(),
            network,
            cameras: cameras.clone(),
            options,
        })
    }

    /// Reads the training views from these cameras, in local coordinates, from here on.
    pub fn set_cameras(&mut self, cameras: &Arc<[Camera]>) {
        self.cameras = cameras.clone();
    }

    /// Records the count of the network's weights that are not finite.
    pub fn record_check(&self, pass: &mut Pass, broken: &Buffer<u32>) {
        self.network_optimizer.record_check(pass, broken);
    }

    /// The network on the host; waits for the GPU.
    pub fn network_state(&self) -> Result<NetworkState, TrainError> {
        let (moments, steps) = self.network_optimizer.state(&self.gpu)?;
        Ok(NetworkState { weights: self.network.network().to_values(&self.gpu)?, moments, steps })
    }

    /// The depth maps on the host, by view; waits for the GPU.
    pub fn depths(&mut self) -> Result<BTreeMap<usize, Vec<f32>>, TrainError> {
        let mut depths = BTreeMap::new();
        for (view, camera) in self.cameras.iter().enumerate() {
            if let Some(map) = self.depths.get(view) {
                depths.insert(view, self.gpu.read(&map, camera.pixels())?);
            }
        }
        Ok(depths)
    }

    /// Resumes from there; a depth map that is missing is rendered when it is needed.
    pub fn restore(&mut self, network: &NetworkState, depths: &BTreeMap<usize, Vec<f32>>) -> Result<(), TrainError> {
        self.set_network(&network.weights)?;
        self.network_optimizer.restore(&self.gpu, &network.moments, network.steps)?;
        self.depths.clear();
        for (&view, depth) in depths {
            self.depths.insert(view, self.gpu.upload("median depth", depth)?);
        }
        Ok(())
    }

    /// Begins with a trained network.
    pub fn set_network(&mut self, weights: &[f32]) -> Result<(), TrainError> {
        if weights.len() != WEIGHTS {
            return Err(NetworkError::Count { found: weights.len() }.into());
        }
        self.network = NetworkParameters::upload(&self.gpu, weights)?;
        let (weights, adam) = (&self.network.network().weights, self.network_optimizer.config());
        self.network_optimizer = TensorOptimizer::new(&self.gpu, weights, WEIGHTS, adam)?;
        Ok(())
    }

    pub fn options(&self) -> &ImageOptions {
        &self.options
    }

    /// Sources of a training view in an iteration, best first.
    pub fn sources_of(&self, index: usize, iteration: u32) -> Vec<usize> {
        let candidates = &self.neighbours[index];
        let used = candidates.len().min(self.options.sources.used as usize);
        match self.options.sources.draw {
            Draw::Nearest => candidates[..used].to_vec(),
            Draw::Random => {
                let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
                rng.set_stream(iteration.into());
                let mut picks = rand::seq::index::sample(&mut rng, candidates.len(), used).into_vec();
                picks.sort_unstable();
                picks.into_iter().map(|pick| candidates[pick]).collect()
            }
        }
    }

    /// What a renderer of the model needs, with the cameras in the scene's coordinates.
    pub fn part(&self, cameras: Arc<[Camera]>, photos: Arc<SourceStore>) -> ImagePart {
        let (network, options) = (self.network.network().clone(), self.options.clone());
        ImagePart { cameras, photos, network, options }
    }

    /// Warps the sources where a loss or the final image reads them, and makes the final image in the iterations that have one.
    pub fn read_sources(&mut self, work: &Work) -> Result<FromSources, GpuError> {
        let is_final = work.schedule.residual_at(work.iteration) && self.residual.fits(&self.cameras[work.index]);
        if work.sources.is_empty() || !(work.warps || is_final) {
            return Ok(FromSources::default());
        }
        let sources = self.sources(work)?;
        let (colors, pass) = autodiff::warped(&self.warper, work.image, work.forward, &sources)?;
        let colors = match work.exposures {
            Some(exposures) => autodiff::exposed_warped(exposures, colors, &pass)?,
            None => colors,
        };
        let warped = WarpedSources { colors, visible: pass.seen.visible.clone() };
        let final_image = is_final.then(|| self.final_image(work, &warped.colors, &pass)).transpose()?;
        Ok(FromSources { warped: Some(warped), final_image })
    }

    fn final_image(&self, work: &Work, colors: &Tensor<3>, pass: &Warped) -> Result<FinalImage, GpuError> {
        let burn_in = work.schedule.burn_in(work.iteration);
        let gain = burn_in.unwrap_or(1.0) as f32;
        let mut task = ResidualTask { camera: self.cameras[work.index], seen: pass.seen.clone(), gain };
        let network = self.network.tensor().autodiff().require_grad();
        // During burn-in only the network learns from the final image.
        let (mut base, mut colors) = match burn_in.is_some() {
            true => (work.shown.clone().detach(), colors.clone().detach()),
            false => (work.shown.clone(), colors.clone()),
        };
        let rows = self.band(work.iteration, task.camera.height);
        if let Some(rows) = &rows {
            let at = |row: u32| row as usize;
            let pixels = task.camera.width as usize;
            base = autodiff::slice(&self.gpu, base, 0, at(rows.start)..at(rows.end))?;
            colors = autodiff::slice(&self.gpu, colors, 1, pixels * at(rows.start)..pixels * at(rows.end))?;
            let mut copies = Pass::new(&self.gpu, "rows of a view");
            task.seen = self.warper.seen_in_rows(&mut copies, pass, rows)?;
            copies.submit();
            task.camera = task.camera.of_rows(rows);
        }
        let image = autodiff::residual(&self.residual, &task, base, colors, network.clone())?;
        Ok(FinalImage { image, rows, network })
    }

    /// The band of a view's rows of which an iteration makes the final image; none: of all.
    fn band(&self, iteration: u32, height: u32) -> Option<Range<u32>> {
        let (bands, rows) = self.config.bands_of(height);
        if bands == 1 {
            return None;
        }
        let mut rng = ChaCha8Rng::seed_from_u64(!self.seed);
        rng.set_stream(iteration.into());
        // The last ends where the view does.
        let first = rng.random_range(0..bands) * (height - rows) / (bands - 1);
        Some(first..first + rows)
    }

    fn sources(&mut self, work: &Work) -> Result<Vec<SourceView>, GpuError> {
        let photos = work.photos.photos(work.sources)?;
        let mut views = Vec::with_capacity(work.sources.len());
        for (&index, photo) in work.sources.iter().zip(photos) {
            let camera = self.cameras[index];
            let view =
                RasterView { surface: Some(self.options.surface), ..RasterView::new(camera, work.splats.sh_degree()) };
            let make = || work.raster.depth_map(work.splats, &view, Room::Checked);
            let depth = self.depths.get_or_make(index, make)?;
            views.push(SourceView { camera, photo, depth });
        }
        Ok(views)
    }

    /// Records the step of the network, a leaf of the iteration's loss.
    pub fn record_step(&mut self, pass: &mut Pass, network: &Tensor<1>, gradients: &mut Gradients, rate: f64) {
        if let Some(gradient) = network.grad_remove(gradients) {
            self.network_optimizer.record_step(pass, &primitive(gradient), rate);
        }
    }

    /// Records the copy of a view's median depth, where it was rendered with its surface.
    pub fn keep_depth(&mut self, pass: &mut Pass, index: usize, forward: &Forward) -> Result<(), GpuError> {
        if let Some(surface) = forward.surface() {
            let pixels = self.cameras[index].pixels();
            let kept = self.depths.get_or_make(index, || self.gpu.allocate("median depth", pixels))?;
            pass.copy(&surface.median_depth, &kept, 0, pixels);
        }
        Ok(())
    }
}
