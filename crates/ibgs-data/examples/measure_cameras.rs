//! Disturbs a scene's training cameras, adjusts them to what their photos have in common, and prints how far they are from those of
//! the scene before and after.
#![allow(clippy::print_stdout)]

use glam::DVec3;
use ibgs_data::camera::Camera;
use ibgs_data::camera_change::CameraChange;
use ibgs_data::dataset::{LoadOptions, View, load, median_depth};
use ibgs_data::matching::adjust_to_photos;
use ibgs_data::similarity::{CameraErrors, Similarity};
use rand::{Rng, SeedableRng};
use std::path::PathBuf;
use std::time::Instant;

fn direction(rng: &mut impl Rng) -> DVec3 {
    loop {
        let way = DVec3::from_array([0; 3].map(|_| rng.random_range(-1.0..1.0)));
        if (0.1..1.0).contains(&way.length()) {
            return way.normalize();
        }
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let path =
        PathBuf::from(arguments.next().ok_or("SCENE [DEGREES [PART OF THE DEPTH [FACTOR OF THE FOCAL LENGTH]]]")?);
    let number = |text: Option<String>, or: f64| text.map_or(Ok(or), |text| text.parse::<f64>());
    let (degrees, part) = (number(arguments.next(), 0.0)?, number(arguments.next(), 0.0)?);
    let factor = number(arguments.next(), 1.0)?;
    let dataset = load(&path, &LoadOptions { eval: true, ..LoadOptions::default() })?;
    let points: Vec<DVec3> = dataset.points.iter().map(|point| point.position).collect();
    let truth: Vec<Camera> = dataset.train.iter().map(|&view| dataset.views[view].camera).collect();
    let depth = |camera: &Camera| median_depth(camera, &points).unwrap_or(1.0);
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
    let mut views: Vec<View> = dataset.train.iter().map(|&view| dataset.views[view].clone()).collect();
    for view in &mut views {
        let (rotation, translation) =
            (direction(&mut rng) * degrees.to_radians(), direction(&mut rng) * part * depth(&view.camera));
        view.camera = view.camera.changed(&CameraChange { rotation, translation, ..CameraChange::default() });
        view.camera.focal *= factor;
    }
    let given: Vec<Camera> = views.iter().map(|view| view.camera).collect();
    let start = Instant::now();
    let photos: Vec<_> = views.iter().map(|view| &view.photo).collect();
    let (adjusted, tracks) = adjust_to_photos(&given, &photos, &())??;
    let seconds = start.elapsed().as_secs_f64();
    let missed = |cameras: &[Camera]| {
        let pairs: Vec<_> = truth.iter().copied().zip(cameras.iter().copied()).collect();
        let CameraErrors { degrees, distance, focal } = Similarity::fit(&pairs).errors(&pairs, depth);
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
        missed(&given),
        missed(&adjusted.cameras),
    );
    Ok(())
}
