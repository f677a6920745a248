//! Cameras that are refined.

use super::dataset;
use crate::small::{plain, run, trainer};
use glam::DVec3;
use ibgs_core::camera::Camera;
use ibgs_core::camera_change::CameraChange;
use ibgs_core::config::{PoseSwitch, TrainConfig};
use ibgs_core::dataset::Dataset;
use ibgs_core::similarity::Similarity;
use ibgs_reference::gpu::{gpu, rasterizer};
use ibgs_train::Trainer;
use std::sync::Arc;

pub fn training_cameras(dataset: &Dataset) -> Vec<Camera> {
    dataset.train.iter().map(|&view| dataset.views[view].camera).collect()
}

/// The same with training cameras that are turned by one degree, each about another axis, and of focal lengths that are 2 % too long.
fn disturbed(mut dataset: Dataset) -> Dataset {
    for (i, &view) in dataset.train.iter().enumerate() {
        let axis = DVec3::new((2.4 * i as f64).sin(), (2.4 * i as f64).cos(), (1.1 * i as f64).sin()).normalize();
        let camera = &mut dataset.views[view].camera;
        let change =
            CameraChange { rotation: axis * 1f64.to_radians(), focal: 0.02 * camera.focal, ..CameraChange::default() };
        *camera = camera.changed(&change);
    }
    dataset
}

/// How far off cameras show the scene's points in their common frame, in pixels, the median of all; and how much too long they are,
/// the mean.
fn errors(cameras: &[Camera], dataset: &Dataset) -> [f64; 2] {
    let truth = training_cameras(dataset);
    let pairs: Vec<_> = truth.iter().copied().zip(cameras.iter().copied()).collect();
    let frame = Similarity::fit(&pairs);
    let mut distances = Vec::new();
    for (truth, camera) in &pairs {
        let seen = dataset.points.iter().filter_map(|point| Some((point.position, truth.seen(point.position)?.0)));
        distances.extend(seen.map(|(point, at)| camera.project(frame.point(point)).0.distance(at)));
    }
    distances.sort_by(f64::total_cmp);
    let lengths = pairs.iter().map(|(truth, camera)| (camera.focal / truth.focal - 1.0).element_sum() / 2.0);
    [distances[distances.len() / 2], lengths.sum::<f64>() / pairs.len() as f64]
}

#[test]
fn cameras_that_are_off_come_nearer_to_the_truth() {
    let dataset = dataset();
    let truth = dataset.clone();
    let mut good = trainer(&dataset, &plain(200));
    run(&mut good, 200);
    let model = good.splats().download(&gpu()).unwrap();
    let disturbed = disturbed(dataset);
    let mut config = TrainConfig { iterations: Some(160), ..plain(160) };
    config.poses.refine = PoseSwitch::On;
    config.poses.from = Some(0);
    (config.poses.learning_rate, config.poses.final_learning_rate) = (4e-3, 4e-4);
    // The Gaussians stay about where they are.
    config.learning_rates.factor = Some(0.05);
    let mut training = Trainer::from_gaussians(Arc::new(rasterizer()), &disturbed, &config, &model).unwrap();
    let before = errors(training.scene_cameras(), &truth);
    run(&mut training, 160);
    let after = errors(training.scene_cameras(), &truth);
    println!("pixels and length from {before:.4?} to {after:.4?}, moved by {:?}", training.moved_cameras());
    assert!(after[0] < 0.5 * before[0], "pixels from {before:.3?} to {after:.3?}");
    assert!(after[1].abs() < 0.6 * before[1], "lengths from {before:.4?} to {after:.4?}");
    config.poses.refine = PoseSwitch::Off;
    let mut still = Trainer::from_gaussians(Arc::new(rasterizer()), &disturbed, &config, &model).unwrap();
    run(&mut still, 5);
    assert_eq!(**still.scene_cameras(), training_cameras(&disturbed));
    assert_eq!(still.moved_cameras(), None);
}
