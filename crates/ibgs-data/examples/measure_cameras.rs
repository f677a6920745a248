//! Disturbs a scene's training cameras, and prints how far they are from those of the scene before and after they are adjusted to what
//! their photos have in common. With a folder, writes the disturbed scene there instead.
//!
//! `measure_cameras SCENE [DEGREES [PERCENT_OF_THE_DEPTH [PERCENT_OF_THE_FOCAL_LENGTH [FOLDER]]]]`: each training camera is turned by
//! so much about another axis and moved by so much another way, the same ones on every run; held-out ones stay. What a model of
//! the disturbed scene is worth, `ibgs eval MODEL --true-cameras SCENE` measures:
//!
//! ```text
//! measure_cameras garden 0.3 0.5 0 garden-off
//! ibgs train garden-off --eval --refine-poses auto -m model
//! ibgs eval model --true-cameras garden
//! ```
#![allow(clippy::print_stdout)]

use glam::DVec3;
use ibgs_data::adjust::Seen;
use ibgs_data::camera::Camera;
use ibgs_data::camera_change::CameraChange;
use ibgs_data::dataset::{Dataset, LoadOptions, Photo, Point, PointsFrom, colmap_text, load, median_depth};
use ibgs_data::files::{create_folder, write_atomically};
use ibgs_data::matching::adjust_to_photos;
use ibgs_data::similarity::{CameraErrors, Similarity};
use image::ImageFormat;
use rand::{Rng, SeedableRng};
use std::collections::HashMap;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;

type Outcome<T> = Result<T, Box<dyn Error>>;

fn main() -> Outcome<()> {
    let mut arguments = std::env::args().skip(1);
    let usage = "SCENE [DEGREES [PERCENT_OF_THE_DEPTH [PERCENT_OF_THE_FOCAL_LENGTH [FOLDER]]]]";
    let path = PathBuf::from(arguments.next().ok_or(usage)?);
    let mut number =
        || arguments.next().map_or(Ok(0.0), |text| text.parse::<f64>().map_err(|_| format!("{text}: {usage}")));
    let [degrees, distance, focal] = [number()?, number()?, number()?];
    let options = LoadOptions { eval: true, ..LoadOptions::default() };
    let dataset = load(&path, &options)?;
    let off = disturbed(&dataset, degrees, 0.01 * distance, 1.0 + 0.01 * focal);
    match arguments.next() {
        Some(folder) => write(&dataset, &off, &options, Path::new(&folder)),
        None => measure(&path, &dataset, &off),
    }
}

fn direction(rng: &mut impl Rng) -> DVec3 {
    loop {
        let way = DVec3::from_array([0; 3].map(|_| rng.random_range(-1.0..1.0)));
        if (0.1..1.0).contains(&way.length()) {
            return way.normalize();
        }
    }
}

/// The median depth of what a camera shows.
fn depth(dataset: &Dataset) -> impl Fn(&Camera) -> f64 {
    let points: Vec<DVec3> = dataset.points.iter().map(|point| point.position).collect();
    move |camera| median_depth(camera, &points).unwrap_or(1.0)
}

/// The training cameras, turned, moved by a part of the depth, and with another lens.
fn disturbed(dataset: &Dataset, degrees: f64, part: f64, factor: f64) -> Vec<Camera> {
    let (mut rng, depth) = (rand_chacha::ChaCha8Rng::seed_from_u64(7), depth(dataset));
    let mut one = |&view: &usize| {
        let camera = dataset.views[view].camera;
        let (rotation, translation) =
            (direction(&mut rng) * degrees.to_radians(), direction(&mut rng) * part * depth(&camera));
        let changed = camera.changed(&CameraChange { rotation, translation, ..CameraChange::default() });
        Camera { focal: changed.focal * factor, ..changed }
    };
    dataset.train.iter().map(&mut one).collect()
}

fn measure(path: &Path, dataset: &Dataset, given: &[Camera]) -> Outcome<()> {
    let truth: Vec<Camera> = dataset.train.iter().map(|&view| dataset.views[view].camera).collect();
    let start = Instant::now();
    let photos: Vec<_> = dataset.train.iter().map(|&view| &dataset.views[view].photo).collect();
    let (adjusted, tracks) = adjust_to_photos(given, &photos, &())??;
    let seconds = start.elapsed().as_secs_f64();
    let depth = depth(dataset);
    let missed = |cameras: &[Camera]| {
        let pairs: Vec<_> = truth.iter().copied().zip(cameras.iter().copied()).collect();
        let CameraErrors { degrees, distance, focal } = Similarity::fit(&pairs).errors(&pairs, &depth);
        [degrees, distance, focal]
    };
    let long = tracks.iter().filter(|track| track.seen.len() > 2).count();
    println!(
        "{}: {} tracks ({long} of three or more), {} observations, median error {:.2} to {:.2} px, {:.5} radians alone, {} astray; degrees, % of the depth, % of \
         the focal length {:.4?} to {:.4?}; {seconds:.1} s",
        path.display(),
        tracks.len(),
        adjusted.observations,
        adjusted.errors[0],
        adjusted.errors[1],
        adjusted.alone,
        adjusted.astray.len(),
        missed(given),
        missed(&adjusted.cameras),
    );
    Ok(())
}

/// Writes the scene with other training cameras as a COLMAP model with photos without distortion, with its points, what the training
/// photos have of them, and its split. A photo has its name whatever its format: what is read goes by the contents.
fn write(dataset: &Dataset, off: &[Camera], options: &LoadOptions, folder: &Path) -> Outcome<()> {
    if folder.exists() {
        return Err(format!("{} exists already; name a new folder", folder.display()).into());
    }
    if dataset.backdrop.is_some() {
        return Err("photos of objects are not written: a COLMAP scene has no such alpha".into());
    }
    let mut cameras: Vec<Camera> = dataset.views.iter().map(|view| view.camera).collect();
    dataset.train.iter().zip(off).for_each(|(&view, camera)| cameras[view] = *camera);
    for view in &dataset.views {
        let path = folder.join("images").join(&view.name);
        create_folder(path.parent().unwrap_or(folder))?;
        let Photo { width, height, rgba } = &*view.photo.pixels()?;
        image::save_buffer_with_format(path, rgba, *width, *height, image::ColorType::Rgba8, ImageFormat::Png)?;
    }
    let names = |views: &[usize]| views.iter().map(|&view| &*dataset.views[view].name).collect::<Vec<_>>();
    let split = serde_json::json!({ "train": names(&dataset.train), "test": names(&dataset.test) });
    let photos = dataset.views.iter().map(|view| &*view.name).zip(&cameras);
    let model = colmap_text(photos, &points(dataset, options)?).map(|(name, text)| (format!("sparse/0/{name}"), text));
    for (name, text) in model.into_iter().chain([("split.json".to_owned(), split.to_string())]) {
        write_atomically(&folder.join(name), |out| out.write_all(text.as_bytes()))?;
    }
    println!("{}: {} photos, {} of them disturbed", folder.display(), cameras.len(), off.len());
    Ok(())
}

/// The scene's own points, and which photos have them.
fn points(dataset: &Dataset, options: &LoadOptions) -> Outcome<Vec<(Point, Vec<Seen>)>> {
    if dataset.points_from != PointsFrom::Scene {
        return Ok(Vec::new());
    }
    let bits = |place: DVec3| place.to_array().map(f64::to_bits);
    let mut seen: HashMap<[u64; 3], Vec<Seen>> = HashMap::new();
    for track in dataset.tracks(options)? {
        if let Some(place) = track.position {
            let of_views = track.seen.iter().map(|seen| Seen { view: dataset.train[seen.view], ..*seen });
            seen.insert(bits(place), of_views.collect());
        }
    }
    Ok(dataset.points.iter().map(|point| (*point, seen.remove(&bits(point.position)).unwrap_or_default())).collect())
}
