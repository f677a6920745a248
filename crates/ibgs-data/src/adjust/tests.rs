//! Cameras of a made scene are found again.

use super::*;
use glam::DMat3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Twelve cameras around points, of two lenses, and what their photos have.
fn scene(noise: f64, outliers: f64) -> (Vec<Camera>, Vec<Track>) {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let camera = |i: usize| Camera {
        width: 640,
        height: 480,
        focal: if i < 7 { DVec2::new(600.0, 610.0) } else { DVec2::splat(500.0) },
        principal: DVec2::new(322.0, 237.0),
        view_from_world: DMat3::from_rotation_x(if i.is_multiple_of(2) { 0.3 } else { -0.1 })
            * DMat3::from_rotation_y(0.4 * i as f64),
        translation: DVec3::new(0.0, 0.1, 4.0 + 0.3 * (i as f64).sin()),
    };
    let cameras: Vec<Camera> = (0..12).map(camera).collect();
    let mut track = || {
        let position = DVec3::from_array([0; 3].map(|_| rng.random_range(-1.0..1.0)));
        let mut seen = Vec::new();
        for (view, camera) in cameras.iter().enumerate() {
            let Some((at, _)) = camera.seen(position) else { continue };
            let is_wrong = rng.random::<f64>() < outliers;
            let mut off = || noise * (0..12).map(|_| rng.random::<f64>() - 0.5).sum::<f64>();
            let pixel = at + DVec2::new(off(), off());
            let wrong = DVec2::new(rng.random_range(0.0..640.0), rng.random_range(0.0..480.0));
            seen.push(Seen { view, pixel: if is_wrong { wrong } else { pixel } });
        }
        Track { position: Some(position), seen }
    };
    let tracks = (0..300).map(|_| track()).collect();
    (cameras, tracks)
}

/// Turned by one degree, moved by 2 % of the distance, focal lengths 2 % off.
fn disturbed(cameras: &[Camera]) -> Vec<Camera> {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut way = |length: f64| {
        let way = DVec3::from_array([0; 3].map(|_| rng.random_range(-1.0..1.0)));
        (way.normalize() * length).to_array()
    };
    let mut one = |camera: &Camera| {
        let ([a, b, c], [d, e, f]) = (way(0.08), way(1_f64.to_radians()));
        moved(camera, [a, b, c, d, e, f, 0.02, -0.02])
    };
    cameras.iter().map(&mut one).collect()
}

/// Largest angle in degrees and distance by which cameras miss the true ones, and part by which focal lengths do.
fn missed(found: &[Camera], truth: &[Camera]) -> [f64; 3] {
    let pairs: Vec<_> = found.iter().copied().zip(truth.iter().copied()).collect();
    let frame = Similarity::fit(&pairs);
    pairs.iter().fold([0.0; 3], |[a, b, c], (found, truth)| {
        let (angle, distance) = frame.residual(found, truth);
        let focal = (found.focal / truth.focal - 1.0).abs().max_element();
        [a.max(angle.to_degrees()), b.max(distance), c.max(focal)]
    })
}

#[test]
fn exact_observations_give_the_cameras_back() {
    let (truth, tracks) = scene(0.0, 0.0);
    let given = disturbed(&truth);
    let adjusted = adjust(&given, &tracks).unwrap();
    assert!(adjusted.errors[0] > 3.0 && adjusted.errors[1] < 1e-7, "{:?}", adjusted.errors);
    assert!(missed(&given, &truth).iter().all(|v| *v > 0.01));
    let missed = missed(&adjusted.cameras, &truth);
    assert!(missed.iter().all(|v| *v < 1e-6), "{missed:?}");
    assert_eq!((adjusted.astray.len(), adjusted.points.len()), (0, 300));
    // In the frame of what was given.
    let frame = Similarity::fit(&adjusted.cameras.iter().copied().zip(given).collect::<Vec<_>>());
    assert!((frame.scale - 1.0).abs() < 0.01 && frame.translation.length() < 0.02, "{frame:?}");
    let again = adjust(&disturbed(&truth), &tracks).unwrap();
    assert_eq!(again.cameras, adjusted.cameras);
}

#[test]
fn noise_and_wrong_observations_do_little_harm() {
    let (truth, tracks) = scene(0.5, 0.1);
    // Of their own lenses: on one ring around a few points, a wrong lens is hardly told from other points.
    let mut given = disturbed(&truth);
    given.iter_mut().zip(&truth).for_each(|(camera, truth)| camera.focal = truth.focal);
    let adjusted = adjust(&given, &tracks).unwrap();
    let missed = missed(&adjusted.cameras, &truth);
    // A tenth of the disturbance: an angle of half a pixel is 0.05 degrees.
    assert!(missed[0] < 0.1 && missed[1] < 0.008 && missed[2] < 0.002, "{missed:?}");
    assert!((0.3..0.9).contains(&adjusted.errors[1]), "{:?}", adjusted.errors);
    assert!(adjusted.astray.is_empty());
}

#[test]
fn a_photo_that_fits_no_other_keeps_its_camera() {
    let (truth, mut tracks) = scene(0.0, 0.0);
    let mut given = disturbed(&truth);
    given[4] = truth[4];
    // Photo 4 shows something else, photo 9 next to nothing.
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    for (number, track) in tracks.iter_mut().enumerate() {
        track.seen.retain(|seen| seen.view != 9 || number < 5);
        for seen in track.seen.iter_mut().filter(|seen| seen.view == 4) {
            seen.pixel = DVec2::new(rng.random_range(0.0..640.0), rng.random_range(0.0..480.0));
        }
    }
    let adjusted = adjust(&given, &tracks).unwrap();
    assert_eq!(adjusted.astray, [4, 9]);
    for view in [4, 9] {
        assert!(adjusted.cameras[view].has_pose_of(&given[view]));
    }
    let rest = |cameras: &[Camera]| [0, 1, 2, 3, 5, 6, 7, 8, 10, 11].map(|view| cameras[view]);
    let missed = missed(&rest(&adjusted.cameras), &rest(&truth));
    assert!(missed.iter().all(|v| *v < 1e-4), "{missed:?}");
}

#[test]
fn without_tracks_or_with_too_many_cameras_nothing_is_adjusted() {
    let (truth, tracks) = scene(0.0, 0.0);
    assert_eq!(adjust(&truth, &[]).unwrap_err(), NotAdjusted::TooFew);
    let many = vec![truth[0]; MOST_CAMERAS + 1];
    assert_eq!(adjust(&many, &tracks).unwrap_err(), NotAdjusted::TooMany(MOST_CAMERAS + 1));
}

/// Photos along a bent way, each point seen by four that follow each other: the whole can bend with hardly an error.
fn chain(noise: f64) -> (Vec<Camera>, Vec<Track>) {
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    let camera = |i: usize| {
        let turn = DMat3::from_rotation_y(0.08 * i as f64);
        let center = DVec3::new(0.5 * i as f64, 0.05 * (i as f64).sin(), 0.02 * (i * i) as f64);
        Camera {
            width: 640,
            height: 480,
            focal: DVec2::splat(600.0),
            principal: DVec2::new(320.0, 240.0),
            view_from_world: turn,
            translation: -(turn * center),
        }
    };
    let cameras: Vec<Camera> = (0..20).map(camera).collect();
    let mut tracks = Vec::new();
    while tracks.len() < 1500 {
        let first = rng.random_range(0..17);
        let pixel = DVec2::new(rng.random_range(60.0..580.0), rng.random_range(40.0..440.0));
        let position = cameras[first + 1].unproject(pixel, rng.random_range(3.0..6.0));
        let mut off = || noise * (0..12).map(|_| rng.random::<f64>() - 0.5).sum::<f64>();
        let seen = (first..first + 4).filter_map(|view| Some((view, cameras[view].seen(position)?.0)));
        let seen: Vec<Seen> = seen.map(|(view, at)| Seen { view, pixel: at + DVec2::new(off(), off()) }).collect();
        tracks.push(Track { position: None, seen });
    }
    (cameras, tracks)
}

/// Mean angle in degrees, and mean distance.
fn mean_missed(found: &[Camera], truth: &[Camera]) -> [f64; 2] {
    let pairs: Vec<_> = found.iter().copied().zip(truth.iter().copied()).collect();
    let frame = Similarity::fit(&pairs);
    let each = pairs.iter().map(|(found, truth)| frame.residual(found, truth));
    each.fold([0.0; 2], |[a, b], (angle, distance)| {
        [a + angle.to_degrees() / pairs.len() as f64, b + distance / pairs.len() as f64]
    })
}

#[test]
fn cameras_that_are_right_stay_and_the_whole_does_not_bend() {
    let (truth, tracks) = chain(0.4);
    let seen: Vec<&[Seen]> = tracks.iter().map(|track| track.seen.as_slice()).collect();
    let (lens_of, views_of) = lenses(&truth);
    let bent = descended(&truth, &seen, (&lens_of, &views_of)).unwrap();
    let [bent, kept] =
        [bent.cameras, adjust(&truth, &tracks).unwrap().cameras].map(|found| mean_missed(&found, &truth));
    println!("without and with an anchor {bent:.4?} {kept:.4?}");
    assert!(bent[0] > 0.05 && kept[0] < 0.1 * bent[0] && kept[1] < 0.1 * bent[1], "{bent:?} {kept:?}");
    // Errors of single cameras do not bend the whole, and are found.
    let given = disturbed(&truth);
    let given: Vec<Camera> = given.iter().map(|camera| Camera { focal: DVec2::splat(600.0), ..*camera }).collect();
    let [before, free, held] = [
        given.clone(),
        descended(&given, &seen, (&lens_of, &views_of)).unwrap().cameras,
        adjust(&given, &tracks).unwrap().cameras,
    ]
    .map(|found| mean_missed(&found, &truth));
    println!("off {before:.4?}, without and with an anchor {free:.4?} {held:.4?}");
    assert!(held[0] < 0.5 * free[0] && held[0] < 0.4 * before[0], "{before:?} {free:?} {held:?}");
    // A lens that is off comes back by more than half, as far as depths differ.
    let long: Vec<Camera> = truth.iter().map(|camera| Camera { focal: camera.focal * 1.02, ..*camera }).collect();
    let lens = adjust(&long, &tracks).unwrap().cameras[0].focal / truth[0].focal;
    assert!((lens - 1.0).abs().max_element() < 0.4 * 0.02, "{lens}");
    // One that is far off comes back all the same.
    let mut one = truth.clone();
    one[9] = moved(&one[9], [0.2, -0.1, 0.1, 0.05, 0.02, -0.04, 0.0, 0.0]);
    let back = adjust(&one, &tracks).unwrap().cameras[9];
    let (angle, _) = Similarity::IDENTITY.residual(&back, &truth[9]);
    assert!(angle.to_degrees() < 0.1, "{}", angle.to_degrees());
}
