//! What the demo's photos have of its points.

use super::{load, tiny};
use glam::DVec3;
use ibgs_data::adjust::{Seen, Track, adjust};
use ibgs_data::camera::Camera;
use ibgs_data::camera_change::CameraChange;
use ibgs_data::dataset::{Dataset, LoadOptions};
use ibgs_data::similarity::{CameraErrors, Similarity};
use ibgs_demo::{self as demo, DemoOptions, WalkerOptions, WalkerPixel};
use std::collections::BTreeSet;

fn training_cameras(dataset: &Dataset) -> Vec<Camera> {
    dataset.train.iter().map(|&view| dataset.views[view].camera).collect()
}

fn options() -> LoadOptions {
    LoadOptions { eval: true, ..LoadOptions::default() }
}

#[test]
fn photos_have_what_they_show() {
    let cache = tempfile::tempdir().expect("folder");
    let set = load(&tiny(), cache.path());
    let truths: Vec<_> = set.views.iter().map(|view| demo::truth(&view.camera)).collect();
    let (mut near, mut all) = (0, 0);
    for Track { position, seen } in &*set.made_tracks {
        let views: BTreeSet<usize> = seen.iter().map(|seen| seen.view).collect();
        assert!(seen.len() > 1 && views.len() == seen.len(), "{seen:?}");
        for seen in seen {
            let camera = &set.views[seen.view].camera;
            let (at, depth) = camera.project(position.expect("a place"));
            let pixel = seen.pixel.y as usize * camera.width as usize + seen.pixel.x as usize;
            let is_near = (f64::from(truths[seen.view].depth[pixel]) - depth).abs() < 0.1;
            // A place is off by a centimetre, an observation by a third of a pixel.
            near += usize::from(is_near && at.distance(seen.pixel) < 2.0);
            all += 1;
        }
    }
    assert!(all > 1_500 && near * 100 > all * 93, "{near} of {all}");
    assert!(set.made_tracks.len() * 10 > set.points.len() * 7, "{}", set.made_tracks.len());
}

#[test]
fn cameras_that_are_off_come_back_by_them() {
    let cache = tempfile::tempdir().expect("folder");
    let scene = DemoOptions { samples: 1, points: 3_000, ..DemoOptions::small() };
    let set = load(&scene, cache.path());
    let (truth, tracks) = (training_cameras(&set), set.tracks(&options()).expect("made tracks"));
    let way = |i: usize, a: f64| {
        DVec3::new((2.4 * i as f64 + a).sin(), (2.4 * i as f64 + a).cos(), (1.1 * i as f64 - a).sin()).normalize()
    };
    let off = |(i, camera): (usize, &Camera)| {
        let (rotation, translation) = (way(i, 0.0) * 0.5_f64.to_radians(), way(i, 1.0) * 0.01);
        camera.changed(&CameraChange { rotation, translation, ..CameraChange::default() })
    };
    let given: Vec<Camera> = truth.iter().enumerate().map(off).collect();
    let missed = |cameras: &[Camera]| {
        let pairs: Vec<_> = truth.iter().copied().zip(cameras.iter().copied()).collect();
        Similarity::fit(&pairs).errors(&pairs, |_| 1.5)
    };
    let (before, adjusted) = (missed(&given), adjust(&given, &tracks).expect("tracks enough"));
    let CameraErrors { degrees, distance, focal } = missed(&adjusted.cameras);
    println!("{before:?} to {degrees} {distance} {focal}, {:?} px, {}", adjusted.errors, adjusted.observations);
    assert!(adjusted.astray.is_empty() && (0.2..0.5).contains(&adjusted.errors[1]), "{:?}", adjusted.errors);
    assert!(degrees < 0.1 * before.degrees && distance < 0.2 * before.distance, "{before:?} to {degrees} {distance}");
    // From the true cameras the error is that of the observations.
    let right = adjust(&truth, &tracks).expect("tracks enough");
    assert!(right.errors[0] < 0.5 && right.errors[1] > 0.6 * right.errors[0], "{:?}", right.errors);
}

#[test]
fn of_many_points_some_have_tracks() {
    let cache = tempfile::tempdir().expect("folder");
    let many = DemoOptions { width: 16, height: 12, samples: 1, views: 4, points: 7_000, ..tiny() };
    let tracks = load(&many, cache.path()).made_tracks.len();
    // Every fifth, and not those on mirrors or astray.
    assert!((900..=1_400).contains(&tracks), "{tracks}");
}

#[test]
fn the_folder_has_them_too() {
    let cache = tempfile::tempdir().expect("folder");
    let walkers = WalkerOptions { scene: tiny(), percent: 50 };
    let walked = demo::walkers(&walkers, Some(cache.path()), &()).expect("walkers");
    let clean = load(&tiny(), cache.path());
    let figures = |set: &Dataset| {
        let seen = set.made_tracks.iter().flat_map(|track| &track.seen);
        let is_figure = |view: usize, pixel: glam::DVec2| {
            let mask = walked.masks[view].as_ref();
            mask.is_some_and(|mask| {
                mask.pixels[pixel.y as usize * mask.width as usize + pixel.x as usize] == WalkerPixel::Figure
            })
        };
        seen.filter(|seen| is_figure(seen.view, seen.pixel)).count()
    };
    assert!(figures(&clean) > 20 && figures(&walked.dataset) == 0, "{} are hidden", figures(&clean));
    for made in [&clean, &walked.dataset] {
        let read = ibgs_data::dataset::load(&made.path, &options()).expect("a scene folder");
        assert_eq!((&read.train, read.made_tracks.len()), (&made.train, 0));
        let [own, found] = [made, &read].map(|set| set.tracks(&options()).expect("tracks"));
        let seen = |tracks: &[Track]| -> Vec<Seen> { tracks.iter().flat_map(|track| track.seen.clone()).collect() };
        assert!(own.len() > 200 && own.len() == found.len(), "{} and {}", own.len(), found.len());
        let mut same = seen(&own).into_iter().zip(seen(&found));
        assert!(same.all(|(a, b)| a.view == b.view && a.pixel.distance(b.pixel) < 1e-9));
        let bits = |place: DVec3| place.to_array().map(f64::to_bits);
        let points: BTreeSet<_> = read.points.iter().map(|point| bits(point.position)).collect();
        assert!(found.iter().all(|track| track.position.is_some_and(|place| points.contains(&bits(place)))));
    }
}
