//! Any unit, any place: a scaled and moved scene trains to the same model.

use super::densifying;
use crate::small::{dataset, staged};
use crate::small::{plain, run, trainer};
use glam::DVec3;
use ibgs_core::config::{ExposureSwitch, Method, TrainConfig};
use ibgs_core::dataset::Dataset;
use ibgs_core::eval::score_view;
use ibgs_train::Trainer;

const FAR: DVec3 = DVec3::new(5e6, -4e6, 1e5);

/// Every length times `scale`, then moved.
pub fn moved(dataset: &Dataset, scale: f64, shift: DVec3) -> Dataset {
    let mut moved = dataset.clone();
    for view in &mut moved.views {
        let camera = &mut view.camera;
        camera.translation = camera.translation * scale - camera.view_from_world * shift;
    }
    moved.points.iter_mut().for_each(|point| point.position = point.position * scale + shift);
    moved
}

/// Mean PSNR over the test views: of the base image, and of the final one where there is one.
fn scores(trainer: &Trainer, dataset: &Dataset) -> [f64; 2] {
    let renderer = trainer.renderer().unwrap();
    let all: Vec<[f64; 2]> = dataset
        .test
        .iter()
        .map(|&index| score_view(&renderer, &dataset.views[index], None).unwrap().1)
        .map(|scores| [scores.base.psnr, scores.image.map_or(0.0, |image| image.psnr)])
        .collect();
    [0, 1].map(|i| all.iter().map(|scores| scores[i]).sum::<f64>() / all.len() as f64)
}

fn every_copy_trains_alike(config: &TrainConfig, copies: &[(f64, DVec3)]) {
    let usual = dataset();
    let train = |dataset: &Dataset| {
        let mut trainer = trainer(dataset, config);
        run(&mut trainer, config.iterations());
        let depth =
            trainer.renderer().unwrap().showing_surface().render(&dataset.views[dataset.test[0]].camera).unwrap();
        (scores(&trainer, dataset), depth.depth_at(24, 18).unwrap().unwrap())
    };
    let (expected, depth) = train(&usual);
    for &(scale, shift) in copies {
        let (found, found_depth) = train(&moved(&usual, scale, shift));
        println!("scale {scale}, moved by {}: {found:.3?} dB, as it is {expected:.3?} dB", shift.length());
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 0.05, "scale {scale}: {found:.3} dB, as it is {expected:.3} dB");
        }
        // Depths are the scene's.
        let ratio = f64::from(found_depth) / (scale * f64::from(depth));
        assert!((ratio - 1.0).abs() < 0.02, "scale {scale}: depth {found_depth}, as it is {depth}");
    }
}

#[test]
fn plain_splatting_is_the_same_in_every_unit_and_place() {
    let copies = [(1e-4, DVec3::ZERO), (30.0, DVec3::ZERO), (1e4, FAR)];
    every_copy_trains_alike(&TrainConfig { method: Method::Gs3, ..densifying(40, 25) }, &copies);
    // Places so far away are rounded in the scene's own doubles; with densification this copy ends at 13.50 in place of 13.37 dB.
    every_copy_trains_alike(&plain(40), &[(1.0, FAR)]);
}

#[test]
fn the_whole_method_is_the_same_in_every_unit_and_place() {
    let mut config = staged(26);
    config.residual.factor = Some(0.5);
    config.exposure.enabled = ExposureSwitch::On;
    config.exposure.from = Some(5);
    every_copy_trains_alike(&config, &[(1e-4, FAR), (1e4, DVec3::ZERO)]);
}
