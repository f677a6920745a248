//! The plane sweep against its twin, and on a wall whose depth is known.

use glam::{DMat3, DVec2, DVec3};
use ibgs_data::camera::Camera;
use ibgs_data::dataset::Photo;
use ibgs_reference::gpu::gpu;
use ibgs_reference::plane_sweep::{best, planes, scores, wall_photo};
use ibgs_render::sources::sweep::{SweepView, sweep};
use std::sync::Arc;

const SLOPE: f64 = 0.3;

fn view(place: DVec3, turn: f64, (width, height): (u32, u32)) -> SweepView {
    let view_from_world = DMat3::from_rotation_y(turn);
    let camera = Camera {
        width,
        height,
        focal: DVec2::new(1.1, 1.2) * f64::from(width),
        principal: DVec2::new(0.47 * f64::from(width), 0.55 * f64::from(height)),
        view_from_world,
        translation: -(view_from_world * place),
    };
    SweepView { photo: Arc::new(wall_photo(&camera, SLOPE)), camera }
}

/// A target and five sources of other sizes, the last of which looks elsewhere.
fn views() -> Vec<SweepView> {
    vec![
        view(DVec3::ZERO, 0.0, (45, 34)),
        view(DVec3::new(0.5, 0.1, 0.0), 0.05, (50, 40)),
        view(DVec3::new(-0.4, 0.0, 0.1), -0.04, (45, 34)),
        view(DVec3::new(0.1, 0.45, -0.1), 0.0, (40, 44)),
        view(DVec3::new(-0.2, -0.5, 0.0), 0.02, (45, 34)),
        view(DVec3::new(0.3, 0.0, 0.0), 3.0, (45, 34)),
    ]
}

/// `keeps`: the pixels of the photo that are not masked.
fn masked(view: &SweepView, keeps: impl Fn(usize) -> bool) -> SweepView {
    let mut photo = Photo::clone(&view.photo);
    for (i, pixel) in photo.rgba.chunks_exact_mut(4).enumerate() {
        pixel[3] = if keeps(i) { 255 } else { 0 };
    }
    SweepView { camera: view.camera, photo: Arc::new(photo) }
}

fn follows(target: &SweepView, sources: &[&SweepView], count: u32) -> usize {
    let inverse = [1.0 / 2.0, 1.0 / 9.0];
    let found = sweep(&gpu(), target, sources, inverse, count).unwrap();
    let inverse = planes(inverse, count);
    let depths: Vec<f64> = inverse.iter().map(|v| 1.0 / v).collect();
    let width = target.camera.width as usize;
    let mut known = 0;
    for (i, &[depth, score]) in found.iter().enumerate() {
        let all = scores(target, sources, ((i % width) as i64, (i / width) as i64), &depths);
        let Some((expected, best)) = best(&inverse, &all) else {
            assert!(score < 0.0, "pixel {i}: {score} where nothing can be compared");
            continue;
        };
        known += 1;
        assert!((f64::from(score) - best).abs() < 2e-3, "pixel {i}: score {score} against {best}");
        // Where two planes are equally good, either may win.
        let second = all.iter().zip(&depths).filter(|(_, depth)| (*depth / expected - 1.0).abs() > 0.1);
        let second = second.filter_map(|(score, _)| *score).fold(-1.0, f64::max);
        if best - second > 5e-3 {
            let error = (f64::from(depth) / expected - 1.0).abs();
            assert!(error < 2e-2, "pixel {i}: depth {depth} against {expected}");
        }
    }
    known
}

#[test]
fn depths_and_scores_follow_the_twin() {
    let all = views();
    let sources: Vec<&SweepView> = all[1..].iter().collect();
    let known = follows(&all[0], &sources, 40);
    assert!(known > 1_000, "{known}");
    // Masks of target and sources.
    let target = masked(&all[0], |i| i % 45 < 30);
    let hidden = masked(&all[1], |i| i / 50 > 20);
    let fewer = follows(&target, &[&hidden, &all[2], &all[3]], 24);
    assert!(fewer > 100 && fewer < known * 3 / 4, "{fewer}");
    assert_eq!(follows(&all[0], &[&all[1]], 24), 0, "one source proves nothing");
}

#[test]
fn the_depth_of_a_wall_is_found() {
    let all = views();
    let sources: Vec<&SweepView> = all[1..].iter().collect();
    let found = sweep(&gpu(), &all[0], &sources, [1.0 / 2.0, 1.0 / 9.0], 96).unwrap();
    let camera = &all[0].camera;
    let (mut good, mut sure) = (0, 0);
    for (i, &[depth, score]) in found.iter().enumerate().filter(|(_, found)| found[1] > 0.9) {
        let at = DVec2::new((i % 45) as f64 + 0.5, (i / 45) as f64 + 0.5);
        let x = (at.x - camera.principal.x) / camera.focal.x;
        let truth = 4.0 / (1.0 - SLOPE * x);
        sure += 1;
        good += usize::from((f64::from(depth) / truth - 1.0).abs() < 0.03);
        assert!(score <= 1.001);
    }
    println!("{good} of {sure} pixels within 3 %");
    assert!(sure > 500 && good * 100 > sure * 95, "{good} of {sure}");
    assert_eq!(found, sweep(&gpu(), &all[0], &sources, [1.0 / 2.0, 1.0 / 9.0], 96).unwrap(), "the same again");
}

#[test]
fn without_sources_nothing_is_found() {
    let all = views();
    let found = sweep(&gpu(), &all[0], &[], [0.5, 0.1], 8).unwrap();
    assert!(found.len() == 45 * 34 && found.iter().all(|found| found[1] < 0.0));
}
