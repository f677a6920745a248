//! What is measured: a model, a camera, and options.

use glam::{DMat3, DVec2, DVec3};
use ibgs_core::camera::Camera;
use ibgs_core::config::{Method, TrainConfig};
use ibgs_core::dataset::{Dataset, Masks, Photo, PointsFrom, View};
use ibgs_core::gpu::GpuError;
use ibgs_core::raster::Rasterizer;
use ibgs_core::render::render_base;
use ibgs_core::scene::{Gaussians, Splats};
use ibgs_core::sources::find::SourceOptions;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// One row of a growth table.
#[derive(Clone, Copy, Debug)]
pub struct Setting<'a> {
    /// The model; of an ensemble the first base.
    pub gaussians: &'a Gaussians,
    /// The other bases of an ensemble, which frames have too. Iterations are those of the first alone.
    pub members: &'a [Gaussians],
    /// The view, in the scene's coordinates.
    pub camera: Camera,
    /// Its options. Only those count that decide how much the stages compute, and the numbers of sources and of median
    /// intersections.
    pub config: &'a TrainConfig,
}

/// A cloud of small Gaussians in front of a camera: the load of a real scene without its files.
pub fn synthetic(count: usize, sh_degree: u32, width: u32, height: u32) -> (Gaussians, Camera) {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut g = Gaussians::with_capacity(count, sh_degree);
    g.sh_degree = sh_degree;
    // A million Gaussians have a standard deviation of about two pixels.
    let size = 0.003 * (1e6 / count.max(1) as f32).sqrt();
    let coefficients = ((sh_degree + 1) * (sh_degree + 1)) as usize;
    for _ in 0..count {
        let depth = rng.random_range(2.0..10.0f32);
        let (x, y) = (rng.random_range(-0.6..0.6f32), rng.random_range(-0.4..0.4f32));
        g.means.push([x * depth, y * depth, depth]);
        g.rotations.push(std::array::from_fn(|_| rng.random_range(-1.0..1.0)));
        g.log_scales.push(std::array::from_fn(|_| (size * depth * rng.random_range(0.1..1.0f32)).ln()));
        g.opacity_logits.push(rng.random_range(-2.0..3.0));
        g.sh.extend((0..3 * coefficients).map(|_| rng.random_range(-0.3..0.3f32)));
        g.normals.push([0.0, 0.0, 1.0]);
        g.offsets.push(0.0);
    }
    let camera = Camera {
        width,
        height,
        focal: DVec2::splat(f64::from(width)),
        principal: DVec2::new(f64::from(width), f64::from(height)) / 2.0,
        view_from_world: DMat3::IDENTITY,
        translation: DVec3::ZERO,
    };
    (g, camera)
}

/// Where the neighbours stand, beside the camera, in local units.
const PLACES: [[f64; 2]; 8] =
    [[0.1, 0.0], [-0.1, 0.0], [0.0, 0.1], [0.0, -0.1], [0.1, 0.1], [-0.1, 0.1], [0.1, -0.1], [-0.1, -0.1]];

/// The camera and `neighbours` (at most eight) beside it, each with the model's own picture as its photo.
pub(super) fn views(
    raster: &Rasterizer,
    splats: &Splats,
    camera: &Camera,
    neighbours: u32,
) -> Result<Dataset, GpuError> {
    let neighbours = &PLACES[..PLACES.len().min(neighbours as usize)];
    let mut views = Vec::new();
    for (index, [x, y]) in std::iter::once(&[0.0, 0.0]).chain(neighbours).enumerate() {
        let moved =
            Camera { translation: camera.translation + splats.space.scale * DVec3::new(*x, *y, 0.0), ..*camera };
        let picture = render_base(raster, splats, &moved)?;
        let rgba = picture.to_rgb8().chunks_exact(3).flat_map(|p| [p[0], p[1], p[2], 255]).collect();
        let photo = Photo { width: camera.width, height: camera.height, rgba }.into();
        views.push(View { name: index.to_string(), camera: moved, photo });
    }
    let train = (0..views.len()).collect();
    Ok(Dataset {
        path: Default::default(),
        views,
        train,
        test: Vec::new(),
        points: Vec::new(),
        extent: None,
        masks: Masks::Ignore,
        backdrop: None,
        glossy: None,
        made_tracks: Default::default(),
        loaded_checksum: None,
        points_from: PointsFrom::Scene,
        notes: Vec::new(),
    })
}

/// Options of a training in which every stage of the method is at work from the second iteration on, no Gaussian is
/// left out and nothing is densified. How much the stages compute is the model's own.
pub(super) fn options(method: Method, model: &TrainConfig) -> TrainConfig {
    let usual = TrainConfig::default();
    let sources = SourceOptions { used: model.sources.used, visible: model.sources.visible, ..usual.sources };
    let (adam, surface, residual) = (model.adam.clone(), model.surface.clone(), model.residual.clone());
    let mut config = TrainConfig { method, sources, adam, surface, residual, ..usual };
    (config.iterations, config.sh_interval, config.densify.end) = (Some(1_000_000), Some(1), Some(1));
    config.learning_rates.mean_initial = 1e-9;
    config.learning_rates.mean_final = 1e-9;
    config.surface.start = Some(0);
    config.residual.start = Some(0);
    config.residual.burn_in = Some(0);
    config.residual.dropout = 0.0;
    config
}
