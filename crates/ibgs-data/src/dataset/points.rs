//! Initial points: from the model, from a PLY file, or random ones.

use super::error::{DatasetError, read_bytes};
use super::points_ply;
use super::{Dataset, HostPhoto, InitialPoints, LoadOptions, Point, PointsFrom, View, hull, shown};
use crate::camera::scene_extent;
use crate::local_space::LocalSpace;
use glam::{DVec2, DVec3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// A cloud and where it came from.
pub(crate) struct Cloud {
    pub path: PathBuf,
    pub points: Vec<Point>,
    pub has_colors: bool,
}

/// The first of the files that exists and holds points.
pub(crate) fn from_files(candidates: &[PathBuf]) -> Result<Option<Cloud>, DatasetError> {
    for path in candidates.iter().filter(|path| path.is_file()) {
        let points_ply::Cloud { points, has_colors } = points_ply::read(path, &read_bytes(path)?)?;
        if !points.is_empty() {
            return Ok(Some(Cloud { path: path.clone(), points, has_colors }));
        }
    }
    Ok(None)
}

/// Points, and the file that they are from, unless that is the scene's model, with whether it has colours.
type Own = (Vec<Point>, Option<(PathBuf, bool)>);

/// A scene's own points: from `init.ply` if it has one, else from `model`, else from a file of points; with the file that they
/// are from, unless that is the model, and whether it has colours.
pub(crate) fn own(model: Vec<Point>, mut files: Vec<PathBuf>, root: &Path) -> Result<Own, DatasetError> {
    files.push(root.join("points3D.ply"));
    let mut cloud = from_files(&[root.join("init.ply")])?;
    if cloud.is_none() && model.is_empty() {
        cloud = from_files(&files)?;
    }
    Ok(cloud.map_or((model, None), |cloud| (cloud.points, Some((cloud.path, cloud.has_colors)))))
}

/// Fills `dataset.points`: with the scene's own ([`own`]), else with random ones. Never leaves it empty.
pub(crate) fn fill(
    dataset: &mut Dataset,
    model: Vec<Point>,
    files: Vec<PathBuf>,
    root: &Path,
    options: &LoadOptions,
) -> Result<(), DatasetError> {
    let (mut points, file) = match options.initial_points {
        InitialPoints::Auto | InitialPoints::Scene => own(model, files, root)?,
        InitialPoints::Photos | InitialPoints::Random => (Vec::new(), None),
    };
    if let Some((path, has_colors)) = file {
        let without = if has_colors { "" } else { ", which has no colours: they begin grey" };
        dataset.notes.push(format!("{} initial points from {}{without}", points.len(), path.display()));
    }
    let count = points.len();
    points.retain(|point| point.position.as_vec3().is_finite());
    // Local coordinates are single precision too.
    let positions = points.iter().map(|point| point.position);
    let space = LocalSpace::of_scene(dataset.views.iter().map(|view| &view.camera), positions);
    points.retain(|point| space.to_local(point.position).as_vec3().is_finite());
    if points.len() < count {
        let dropped = count - points.len();
        dataset.notes.push(format!("{dropped} initial points are not finite and were dropped"));
    }
    if options.split.is_some() {
        keep_shown(&mut points, dataset);
    }
    if points.is_empty() {
        (points, dataset.points_from) = made(dataset, options)?;
        let count = points.len();
        let how =
            if dataset.points_from == PointsFrom::Hull { "in the visual hull of the object" } else { "random ones" };
        let why = match options.initial_points {
            InitialPoints::Auto | InitialPoints::Scene => "the scene has no initial points",
            _ => "the scene's own points are not used",
        };
        dataset.notes.push(format!("{why}: {count} {how} stand in (seed {})", options.seed));
    }
    dataset.points = points;
    Ok(())
}

/// At most `most` of the points, evenly taken.
pub fn thinned(points: &[Point], most: usize) -> Vec<Point> {
    let kept = points.len().min(most);
    (0..kept).map(|i| points[i * points.len() / kept]).collect()
}

/// Keeps the points that a training view shows.
fn keep_shown(points: &mut Vec<Point>, dataset: &Dataset) {
    let positions: Vec<DVec3> = points.iter().map(|point| point.position).collect();
    let seen: Vec<AtomicBool> = positions.iter().map(|_| AtomicBool::new(false)).collect();
    dataset.train.par_iter().for_each(|&view| {
        for (_, point) in shown(&dataset.views[view].camera, &positions) {
            seen[point as usize].store(true, Ordering::Relaxed);
        }
    });
    let mut seen = seen.into_iter();
    points.retain(|_| seen.next().is_some_and(AtomicBool::into_inner));
}

/// Points of a scene that has none, and what they are: in the visual hull of an object, else random ones.
fn made(dataset: &Dataset, options: &LoadOptions) -> Result<(Vec<Point>, PointsFrom), DatasetError> {
    if options.initial_points == InitialPoints::Random {
        return Ok((random(&dataset.views, options)?, PointsFrom::Random));
    }
    if options.shows_object() {
        let views: Vec<&View> = dataset.train.iter().map(|&view| &dataset.views[view]).collect();
        let points = hull::points(&views, options.random_points as usize, options.seed)?;
        if !points.is_empty() {
            return Ok((points, PointsFrom::Hull));
        }
    }
    Ok((random(&dataset.views, options)?, PointsFrom::Chance))
}

/// Depths of random points, in scene extents: near enough for a camera ring that looks inward (its subject lies
/// at about 1), far enough for a small forward-facing rig.
const DEPTHS: [f64; 2] = [0.3, 30.0];
/// The same for photos of a single object with nothing behind it.
const DEPTHS_OF_ONE_THING: [f64; 2] = [0.3, 2.0];
/// Tries to hit a pixel that is neither masked nor background.
const TRIES: usize = 8;

/// Random points that some camera sees: a random view, a random pixel of it that shows something, a depth between
/// [`DEPTHS`] whose logarithm is uniform, the colour of that pixel. The extent is that of the cameras, 1 where they coincide.
fn random(views: &[View], options: &LoadOptions) -> Result<Vec<Point>, DatasetError> {
    if views.is_empty() {
        return Ok(Vec::new());
    }
    let (_, extent) = scene_extent(views.iter().map(|view| &view.camera));
    let extent = if extent > 0.0 && extent.is_finite() { extent } else { 1.0 };
    let [near, far] = if options.shows_object() { DEPTHS_OF_ONE_THING } else { DEPTHS };
    let shows = |[_, _, _, a]: [u8; 4]| a >= 128;
    let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
    // View by view: photos may have to be decoded again.
    let mut of_view = vec![0; views.len()];
    (0..options.random_points).for_each(|_| of_view[rng.random_range(0..views.len())] += 1);
    let mut points = Vec::with_capacity(options.random_points as usize);
    for (number, (view, count)) in views.iter().zip(of_view).enumerate() {
        HostPhoto::decode_next(views[number + 1..].iter().map(|view| &view.photo));
        let photo = view.photo.pixels()?;
        let (width, height) = (photo.width, photo.height);
        let pixel = |rng: &mut ChaCha8Rng| {
            let (x, y) = (rng.random_range(0..width), rng.random_range(0..height));
            let at = (y as usize * width as usize + x as usize) * 4;
            (x, y, [0, 1, 2, 3].map(|c| photo.rgba.get(at + c).copied().unwrap_or_default()))
        };
        for _ in 0..count {
            let mut drawn = pixel(&mut rng);
            for _ in 1..TRIES {
                if shows(drawn.2) {
                    break;
                }
                drawn = pixel(&mut rng);
            }
            let (x, y, [r, g, b, _]) = drawn;
            let ray = view.camera.ray(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
            let depth = extent * near * (far / near).powf(rng.random::<f64>());
            points.push(Point { position: view.camera.center() + ray * depth, color: [r, g, b] });
        }
    }
    Ok(points)
}
