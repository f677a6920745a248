//! Observations of real scenes, and cameras that come back by them.

use crate::dataset::load;
use glam::DVec3;
use ibgs_data::adjust::adjust;
use ibgs_data::camera::Camera;
use ibgs_data::camera_change::CameraChange;
use ibgs_data::dataset::LoadOptions;
use ibgs_data::similarity::Similarity;
use ibgs_testing::shared;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::time::Instant;

/// Each camera turned by as many degrees and moved by a part of the depth, any way.
fn disturbed(cameras: &[Camera], degrees: f64, part: f64, depth: f64) -> Vec<Camera> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut way = || DVec3::from_array([0; 3].map(|_| rng.random_range(-1.0..1.0))).normalize();
    let mut one = |camera: &Camera| {
        let (translation, rotation) = (way() * part * depth, way() * degrees.to_radians());
        camera.changed(&CameraChange { translation, rotation, ..CameraChange::default() })
    };
    cameras.iter().map(&mut one).collect()
}

/// Mean angle in degrees and distance by which cameras miss others, apart from a similarity.
fn missed(found: &[Camera], truth: &[Camera]) -> [f64; 2] {
    let pairs: Vec<_> = found.iter().copied().zip(truth.iter().copied()).collect();
    let (frame, count) = (Similarity::fit(&pairs), pairs.len() as f64);
    pairs.iter().fold([0.0; 2], |[a, b], (found, truth)| {
        let (angle, distance) = frame.residual(found, truth);
        [a + angle.to_degrees() / count, b + distance / count]
    })
}

#[test]
fn cameras_of_real_scenes_come_back_by_their_tracks() {
    for name in ["fox", "fern"] {
        let test = "dataset::tracks::cameras_of_real_scenes_come_back_by_their_tracks";
        let Some(path) = shared(&format!("data/{name}"), test) else { continue };
        let options = LoadOptions { eval: true, ..Default::default() };
        let dataset = load(&path, &options);
        let tracks = dataset.tracks(&options).unwrap();
        let truth: Vec<Camera> = dataset.train.iter().map(|&view| dataset.views[view].camera).collect();
        assert!(tracks.iter().all(|track| track.position.is_some()));
        assert!(tracks.iter().flat_map(|track| &track.seen).all(|seen| seen.view < truth.len()));
        let mut depths: Vec<f64> =
            tracks.iter().filter_map(|track| Some(truth[track.seen[0].view].to_view(track.position?).z)).collect();
        depths.sort_by(f64::total_cmp);
        let depth = depths[depths.len() / 2];
        for (degrees, part) in [(0.0, 0.0), (0.3, 0.005), (1.0, 0.02)] {
            let given = disturbed(&truth, degrees, part, depth);
            let started = Instant::now();
            let adjusted = adjust(&given, &tracks).unwrap();
            let (before, after) = (missed(&given, &truth), missed(&adjusted.cameras, &truth));
            eprintln!(
                "{name} {degrees}: {:.2} s, {} observations, {:?} px, {before:?} to {after:?} of {depth}, astray {:?}",
                started.elapsed().as_secs_f64(),
                adjusted.observations,
                adjusted.errors,
                adjusted.astray
            );
            assert!(adjusted.errors[1] < 1.0 && adjusted.astray.is_empty());
            assert!(after[0] < 0.06, "{name}: {after:?}");
        }
    }
}
