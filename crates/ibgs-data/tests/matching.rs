//! Cameras of a scene without observations are found by its photos alone.

use glam::{DMat3, DVec2, DVec3};
use ibgs_data::adjust::NotAdjusted;
use ibgs_data::camera::Camera;
use ibgs_data::camera_change::CameraChange;
use ibgs_data::dataset::{HostPhoto, Photo};
use ibgs_data::matching::adjust_to_photos;
use ibgs_data::similarity::Similarity;

/// Mean angle in degrees, and mean distance.
fn missed(found: &[Camera], truth: &[Camera]) -> [f64; 2] {
    let pairs: Vec<_> = found.iter().copied().zip(truth.iter().copied()).collect();
    let frame = Similarity::fit(&pairs);
    let each = pairs.iter().map(|(found, truth)| frame.residual(found, truth));
    each.fold([0.0; 2], |[a, b], (angle, distance)| {
        [a + angle.to_degrees() / pairs.len() as f64, b + distance / pairs.len() as f64]
    })
}

/// Random values on a grid, smooth between; of three grids.
fn texture(at: DVec2, seed: u64) -> f64 {
    let value = |x: i64, y: i64, octave: u64| {
        let mix = (x as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ (y as u64).wrapping_mul(0xC2B2_AE3D_27D4_EB4F);
        let mix = (mix ^ (seed + octave)).wrapping_mul(0xD6E8_FEB8_6659_FD93);
        ((mix ^ (mix >> 32)).wrapping_mul(0xD6E8_FEB8_6659_FD93) >> 40) as f64 / (1_u64 << 24) as f64
    };
    let octave = |octave: u64| {
        let at = at * [4.0, 9.0, 20.0][octave as usize];
        let (cell, part) = (at.floor(), at - at.floor());
        let [x, y] = [cell.x as i64, cell.y as i64];
        let row = |y: i64| value(x, y, octave) * (1.0 - part.x) + value(x + 1, y, octave) * part.x;
        row(y) * (1.0 - part.y) + row(y + 1) * part.y
    };
    (octave(0) + octave(1) + octave(2)) / 3.0
}

/// What a camera shows of two walls that meet at a corner.
fn photo(camera: &Camera) -> Photo {
    let bright = |at: DVec2| {
        let (from, ray) = (camera.center(), camera.ray(at));
        let walls =
            [(DVec3::X, 1), (DVec3::Z, 2)].map(|(normal, seed)| (-from.dot(normal) / ray.dot(normal), normal, seed));
        let (far, normal, seed) =
            walls.into_iter().filter(|wall| wall.0 > 0.0).min_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
        let hit = from + ray * far;
        texture(DVec2::new(hit.y, hit.dot(DVec3::ONE - normal - DVec3::Y)), seed)
    };
    let corners = [[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]].map(DVec2::from_array);
    let pixel = |i: u32| {
        let at = DVec2::new(f64::from(i % camera.width), f64::from(i / camera.width));
        let value = corners.iter().map(|corner| bright(at + *corner)).sum::<f64>() / 4.0;
        [(255.0 * value) as u8; 3].into_iter().chain([255])
    };
    Photo {
        width: camera.width,
        height: camera.height,
        rgba: (0..camera.width * camera.height).flat_map(pixel).collect(),
    }
}

/// Ten cameras before the corner.
fn cameras() -> Vec<Camera> {
    let camera = |i: usize| {
        let angle = 0.5 + 0.08 * i as f64;
        let center = DVec3::new(2.5 * angle.cos(), 0.3 * (i as f64).sin(), 2.5 * angle.sin());
        let forward = -center.normalize();
        let right = DVec3::Y.cross(forward).normalize();
        let turn = DMat3::from_cols(right, forward.cross(right), forward).transpose();
        Camera {
            width: 180,
            height: 136,
            focal: DVec2::splat(160.0),
            principal: DVec2::new(91.0, 67.0),
            view_from_world: turn,
            translation: -(turn * center),
        }
    };
    (0..10).map(camera).collect()
}

#[test]
fn cameras_fit_what_their_photos_have_in_common() {
    let truth = cameras();
    let photos: Vec<HostPhoto> = truth.iter().map(|camera| HostPhoto::from(photo(camera))).collect();
    let photos: Vec<&HostPhoto> = photos.iter().collect();
    let off = |(i, camera): (usize, &Camera)| {
        let way =
            |a: f64| DVec3::new((2.4 * i as f64 + a).sin(), (2.4 * i as f64 + a).cos(), (1.1 * i as f64 - a).sin());
        let (rotation, translation) = (way(0.0) * 0.7_f64.to_radians(), way(1.0) * 0.02);
        camera.changed(&CameraChange { rotation, translation, ..CameraChange::default() })
    };
    let given: Vec<Camera> = truth.iter().enumerate().map(off).collect();
    let (adjusted, tracks) = adjust_to_photos(&given, &photos, &()).unwrap().unwrap();
    let [before, after] = [&given, &adjusted.cameras].map(|cameras| missed(cameras, &truth));
    println!(
        "{} tracks, pixels {:.3?}, degrees and distance from {before:.4?} to {after:.4?}",
        tracks.len(),
        adjusted.errors
    );
    assert!(before[0] > 0.5 && after[0] < 0.2 * before[0] && after[1] < 0.2 * before[1], "{before:?} {after:?}");
    // Those that are right stay.
    let (kept, _) = adjust_to_photos(&truth, &photos, &()).unwrap().unwrap();
    let kept = missed(&kept.cameras, &truth);
    println!("kept {kept:?}");
    assert!(kept[0] < 0.02 * before[0] && kept[1] < 0.02 * before[1], "{kept:?}");
    // Photos that show nothing.
    let plain = HostPhoto::from(Photo { width: 180, height: 136, rgba: vec![128; 180 * 136 * 4] });
    assert_eq!(adjust_to_photos(&truth, &[&plain; 10], &()).unwrap().unwrap_err(), NotAdjusted::TooFew);
    // Too many: nothing is looked for.
    let many = adjust_to_photos(&[truth[0]; 501], &[photos[0]; 501], &());
    assert_eq!(many.unwrap().unwrap_err(), NotAdjusted::TooMany(501));
}
