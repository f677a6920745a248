//! Depth maps from photos and poses alone, by plane sweep, and the points that they agree on.

use super::find::{SourceFinder, SourceOptions};
use crate::camera::Camera;
use crate::dataset::{Dataset, DatasetError, Photo, Point, View, thinned};
use crate::gpu::{Gpu, GpuError, Pass};
use crate::progress::Progress;
use glam::DVec2;
use ibgs_shaders::TILE;
use ibgs_shaders::bindings::PlaneSweepBindings;
use ibgs_shaders::types::{SweepParams, SweepSource};
use rayon::prelude::*;
use std::sync::Arc;

/// Longer side of the photos, in pixels, of the first sweep, which finds where things are, and of the second.
const SIDES: [u32; 2] = [128, 256];
/// Planes of both.
const PLANES: [u32; 2] = [256, 128];
/// Nearest plane of the first sweep, in extents of the cameras.
const NEAREST: f64 = 0.1;
/// Its farthest plane, likewise.
const FARTHEST: f64 = 200.0;
/// Sources of a view: every second of the nearest views.
const SOURCES: usize = 6;
/// Least score of a depth.
const LEAST_SCORE: f32 = 0.75;
/// Depths agree that differ by less than this part, or by less than this part of what lies between two planes there.
const AGREEMENT: f64 = 0.02;
const AGREEMENT_PLANES: f64 = 0.75;
/// Sources that must agree.
const LEAST_AGREEING: usize = 2;
/// What lies beyond this share of a view's depths on either side is not swept again, but for a margin.
const OUTLIERS: f64 = 0.02;
/// The margin, as a factor on depths.
const MARGIN: f64 = 1.5;
/// Views that are swept; of more, every n-th.
const MOST_VIEWS: usize = 400;
/// Pixels that are asked for each point that is wanted.
const ASKED: usize = 32;
/// Fewer points are no start.
const LEAST_POINTS: usize = 500;

/// A view of a sweep.
#[derive(Clone, Debug)]
pub struct SweepView {
    /// Its camera.
    pub camera: Camera,
    /// Its photo.
    pub photo: Arc<Photo>,
}

/// Sweeps planes through a view and asks at each how well the sources agree with it: for every pixel, row by row, the view depth
/// at which they agree best and how well, as a correlation up to 1; a score under 0 where nothing can be compared. `inverse` is the
/// inverse depth of the first and the last plane.
///
/// # Errors
/// Not enough memory, or the device is lost.
pub fn sweep(
    gpu: &Gpu,
    target: &SweepView,
    sources: &[&SweepView],
    inverse: [f64; 2],
    planes: u32,
) -> Result<Vec<[f32; 2]>, GpuError> {
    let pixels = target.camera.pixels();
    if sources.is_empty() || pixels == 0 {
        return Ok(vec![[0.0, -1.0]; pixels]);
    }
    let (photos, placed) = gather(target, sources);
    let photos = gpu.upload("photos of a sweep", &photos)?.cast();
    let placed = gpu.upload("sources of a sweep", &placed)?;
    let found = gpu.allocate("depths of a sweep", pixels)?;
    let camera = &target.camera;
    let params = SweepParams {
        size: [camera.width, camera.height],
        planes: planes.max(2),
        sources: sources.len() as u32,
        focal: camera.focal.as_vec2().to_array(),
        principal: (camera.principal - 0.5).as_vec2().to_array(),
        nearest: inverse[0] as f32,
        farthest: inverse[1] as f32,
        pad: [0; 2],
    };
    let mut pass = Pass::new(gpu, "plane sweep");
    let buffers = PlaneSweepBindings { photos: &photos, sources: &placed, found: &found };
    let tiles = params.size.map(|side| side.div_ceil(TILE));
    pass.grid(&buffers, &params, [tiles[0], tiles[1], 1]);
    pass.submit();
    gpu.read(&found, pixels)
}

/// The texels of all photos, and where those of each source lie.
fn gather(target: &SweepView, sources: &[&SweepView]) -> (Vec<u8>, Vec<SweepSource>) {
    let mut texels = target.photo.rgba.clone();
    let place = |source: &&SweepView| {
        let camera = &source.camera;
        let offset = texels.len() as u32 / 4;
        texels.extend_from_slice(&source.photo.rgba);
        SweepSource {
            rows: camera.rows_from(&target.camera),
            focal: camera.focal.as_vec2().to_array(),
            principal: (camera.principal - 0.5).as_vec2().to_array(),
            size: [camera.width, camera.height],
            offset,
            pad: 0,
        }
    };
    let placed = sources.iter().map(place).collect();
    (texels, placed)
}

/// The depths of a view, with their scores.
struct DepthMap {
    width: usize,
    values: Vec<[f32; 2]>,
    /// What lies between two planes, in inverse depth.
    step: f64,
}

impl DepthMap {
    /// The depth of a pixel that is sure of it.
    fn at(&self, index: usize) -> Option<f64> {
        let [depth, score] = self.values[index];
        (score >= LEAST_SCORE).then_some(f64::from(depth))
    }

    /// By how much depths may differ from this one to agree with it.
    fn tolerance(&self, depth: f64) -> f64 {
        depth * AGREEMENT.max(AGREEMENT_PLANES * self.step * depth)
    }
}

/// Views of one size, their sources, and their depths.
struct Swept {
    views: Vec<SweepView>,
    sources: Vec<Vec<usize>>,
    maps: Vec<DepthMap>,
}

impl Swept {
    fn new(
        gpu: &Gpu,
        views: &[View],
        inverse: impl Fn(usize) -> [f64; 2],
        planes: u32,
        progress: &dyn Progress,
    ) -> Result<Self, GpuError> {
        let decoded = |view: &View| {
            let photo = view.photo.pixels().map_err(|error| GpuError::Photo(error.to_string()))?;
            Ok(SweepView { camera: view.camera, photo })
        };
        let views = views.iter().map(decoded).collect::<Result<Vec<_>, GpuError>>()?;
        let cameras: Vec<Camera> = views.iter().map(|view| view.camera).collect();
        let options = SourceOptions { neighbours: 2 * SOURCES as u32, max_angle_deg: 45.0, ..SourceOptions::default() };
        let finder = SourceFinder::new(&cameras, &options);
        let chosen = |(index, camera): (usize, &Camera)| {
            let near = finder.neighbours(camera, Some(index));
            let step = if near.len() > SOURCES { 2 } else { 1 };
            near.into_iter().step_by(step).take(SOURCES).collect()
        };
        let sources: Vec<Vec<usize>> = cameras.iter().enumerate().map(chosen).collect();
        let mut maps = Vec::with_capacity(views.len());
        for (index, view) in views.iter().enumerate() {
            let sources: Vec<&SweepView> = sources[index].iter().map(|&source| &views[source]).collect();
            let inverse = inverse(index);
            let values = sweep(gpu, view, &sources, inverse, planes)?;
            let step = (inverse[0] - inverse[1]) / f64::from(planes - 1);
            maps.push(DepthMap { width: view.camera.width as usize, values, step });
            progress.step();
        }
        Ok(Self { views, sources, maps })
    }

    /// Depth and point of each pixel of a view, or of every so many, on which enough of its sources agree.
    fn agreed(&self, index: usize, every: usize) -> Vec<(f64, Point)> {
        let (view, map) = (&self.views[index], &self.maps[index]);
        let agrees = |point: glam::DVec3, source: &usize| {
            let (camera, map) = (&self.views[*source].camera, &self.maps[*source]);
            camera.seen(point).is_some_and(|(at, depth)| {
                let own = map.at(at.y as usize * map.width + at.x as usize);
                own.is_some_and(|own| (own - depth).abs() <= map.tolerance(depth))
            })
        };
        let point = |pixel: usize| {
            let depth = map.at(pixel)?;
            let at = DVec2::new((pixel % map.width) as f64 + 0.5, (pixel / map.width) as f64 + 0.5);
            let position = view.camera.unproject(at, depth);
            let agreeing = self.sources[index].iter().filter(|source| agrees(position, source)).count();
            let color = [0, 1, 2].map(|c| view.photo.rgba[4 * pixel + c]);
            (agreeing >= LEAST_AGREEING).then_some((depth, Point { position, color }))
        };
        (0..map.values.len()).into_par_iter().step_by(every).filter_map(point).collect()
    }
}

/// Points on the surfaces that the training views show, from their photos alone: at most `most`, evenly taken from all that were
/// found; empty where too few were. The same on the same adapter.
///
/// # Errors
/// Not enough memory, the device is lost, or a photo cannot be decoded again.
pub fn points(gpu: &Gpu, dataset: &Dataset, most: usize, progress: &dyn Progress) -> Result<Vec<Point>, GpuError> {
    let step = dataset.train.len().div_ceil(MOST_VIEWS).max(1);
    let swept: Vec<usize> = dataset.train.iter().step_by(step).copied().collect();
    let small = |side: u32| {
        let reduced: Result<Dataset, DatasetError> = dataset.reduced(&swept, side);
        reduced.map(|dataset| dataset.views).map_err(|error| GpuError::Photo(error.to_string()))
    };
    progress.begin("finding points in the photos", 2 * swept.len());
    let views = small(SIDES[0])?;
    let (_, extent) = crate::camera::scene_extent(views.iter().map(|view| &view.camera));
    let extent = crate::camera::usable_extent(extent);
    let whole = [1.0 / (NEAREST * extent), 1.0 / (FARTHEST * extent)];
    let first = Swept::new(gpu, &views, |_| whole, PLANES[0], progress)?;
    let mut ranges: Vec<Option<[f64; 2]>> = Vec::with_capacity(views.len());
    for index in 0..views.len() {
        ranges.push(range(first.agreed(index, 1).into_iter().map(|(depth, _)| depth).collect(), whole));
    }
    let second = Swept::new(gpu, &small(SIDES[1])?, |index| ranges[index].unwrap_or(whole), PLANES[1], progress)?;
    let pixels: usize = second.maps.iter().map(|map| map.values.len()).sum();
    let every = (pixels / (ASKED * most)).max(1);
    let points: Vec<Point> =
        (0..views.len()).flat_map(|index| second.agreed(index, every).into_iter().map(|(_, point)| point)).collect();
    progress.end();
    if points.len() < LEAST_POINTS {
        return Ok(Vec::new());
    }
    Ok(thinned(&points, most))
}

/// The inverse depths to sweep again: those of the nearest and the farthest depth but for outliers, with a margin. None where a
/// view knows too few.
fn range(mut depths: Vec<f64>, whole: [f64; 2]) -> Option<[f64; 2]> {
    if depths.len() < LEAST_POINTS / 10 {
        return None;
    }
    depths.sort_by(f64::total_cmp);
    let out = (OUTLIERS * depths.len() as f64) as usize;
    let (near, far) = (depths[out] / MARGIN, depths[depths.len() - 1 - out] * MARGIN);
    Some([(1.0 / near).min(whole[0]), (1.0 / far).max(whole[1])])
}
