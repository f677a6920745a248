//! Neighbour choice against a slow second reading of method.md section 4, and on real scenes.

use glam::{DMat3, DMat4, DQuat, DVec2, DVec3};
use ibgs_data::camera::Camera;
use ibgs_data::dataset::{self, Dataset, LoadOptions};
use ibgs_demo::{DemoOptions, cameras};
use ibgs_model::output::multi_view;
use ibgs_render::sources::find::{Distances, LEAST, SourceFinder, SourceOptions, neighbours};
use ibgs_testing::shared;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn camera(rotation: DQuat, center: DVec3) -> Camera {
    let view_from_world = DMat3::from_quat(rotation);
    Camera {
        width: 40,
        height: 30,
        focal: DVec2::splat(30.0),
        principal: DVec2::new(20.0, 15.0),
        view_from_world,
        translation: -(view_from_world * center),
    }
}

/// Cameras of one cloud, turned up to about 60 degrees.
fn random_cameras(count: usize, size: f64, seed: u64) -> Vec<Camera> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..count)
        .map(|_| {
            let mut vector = || DVec3::from([0; 3].map(|_| rng.random_range(-1.0..1.0)));
            let (axis, center) = (vector().normalize(), size * vector());
            camera(DQuat::from_axis_angle(axis, rng.random_range(0.0..1.0)), center)
        })
        .collect()
}

fn absolute() -> SourceOptions {
    SourceOptions { distances: Distances::Absolute, ..SourceOptions::default() }
}

/// method.md section 4 read literally, with homogeneous matrices.
fn oracle(target: &Camera, exclude: Option<usize>, cameras: &[Camera], limits: [f64; 3]) -> Vec<usize> {
    let pose = |c: &Camera| DMat4::from_mat3(c.view_from_world).w_axis_set(c.translation);
    let mut left: Vec<usize> = (0..cameras.len())
        .filter(|&i| Some(i) != exclude)
        .filter(|&i| {
            let cosine = (pose(target).row(2).truncate()).dot(pose(&cameras[i]).row(2).truncate());
            cosine > limits[0].to_radians().cos()
                && target.center().distance(cameras[i].center()) >= limits[1]
                && target.center().distance(cameras[i].center()) <= limits[2]
        })
        .collect();
    left.sort_by(|&a, &b| {
        let distance = |i: usize| target.center().distance(cameras[i].center());
        distance(a).total_cmp(&distance(b))
    });
    left.truncate(8);
    left
}

trait WithTranslation {
    fn w_axis_set(self, translation: DVec3) -> Self;
}

impl WithTranslation for DMat4 {
    fn w_axis_set(mut self, translation: DVec3) -> Self {
        self.w_axis = translation.extend(1.0);
        self
    }
}

#[test]
fn absolute_thresholds_agree_with_the_oracle() {
    let mut chosen = 0;
    for seed in 0..20 {
        let cameras = random_cameras(40, 1.2, seed);
        let targets = random_cameras(5, 1.2, 100 + seed);
        let finder = SourceFinder::new(&cameras, &absolute());
        let own = cameras.iter().enumerate().map(|(i, c)| (c, Some(i)));
        for (target, exclude) in own.chain(targets.iter().map(|c| (c, None))) {
            let found = finder.neighbours(target, exclude);
            assert_eq!(found, oracle(target, exclude, &cameras, [30.0, 0.01, 1.5]));
            assert!(exclude.is_none_or(|own| !found.contains(&own)));
            chosen += found.len();
        }
    }
    println!("{chosen} sources chosen");
    assert!(chosen > 2_500);
}

#[test]
fn adaptive_thresholds_do_not_depend_on_the_scale() {
    let cameras = random_cameras(60, 1.0, 3);
    let scaled = |factor: f64| -> Vec<Camera> {
        cameras.iter().map(|c| Camera { translation: factor * c.translation, ..*c }).collect()
    };
    let options = SourceOptions::default();
    let lists = |cameras: &[Camera]| -> Vec<Vec<usize>> {
        let finder = SourceFinder::new(cameras, &options);
        cameras.iter().enumerate().map(|(i, c)| finder.neighbours(c, Some(i))).collect()
    };
    let expected = lists(&cameras);
    assert!(expected.iter().all(|list| list.len() >= 4), "{expected:?}");
    for factor in [1e-4, 0.5, 4096.0] {
        assert_eq!(lists(&scaled(factor)), expected, "times {factor}");
    }
    let [least, most] = SourceFinder::new(&cameras, &options).distances();
    let brute = |i: usize, list: &[usize]| {
        list.iter().map(|&j| cameras[i].center().distance(cameras[j].center())).collect::<Vec<_>>()
    };
    assert!(least > 0.0 && least < most);
    for (i, list) in expected.iter().enumerate() {
        let distances = brute(i, list);
        assert!(distances.is_sorted() && distances.iter().all(|d| *d >= least));
        // Only lists that would have been too short reach farther.
        assert!(list.len() == 4 || distances.iter().all(|d| *d <= most));
    }
}

#[test]
fn odd_captures() {
    let options = SourceOptions::default();
    let turned = |degrees: f64, x: f64| camera(DQuat::from_rotation_y(degrees.to_radians()), DVec3::new(x, 0.0, 0.0));
    assert!(neighbours(&turned(0.0, 0.0), None, &[], &options).is_empty());
    let pair = [turned(0.0, 0.0), turned(0.0, 1.0)];
    assert_eq!(neighbours(&pair[0], Some(0), &pair, &options), [1]);
    // A tripod: parallax none, still each other's sources.
    let tripod = [0.0, 10.0, 20.0].map(|angle| turned(angle, 0.0));
    assert_eq!(neighbours(&tripod[0], Some(0), &tripod, &options), [1, 2], "ties go by angle");
    assert!(neighbours(&tripod[0], Some(0), &tripod, &absolute()).is_empty());
    // A second photo from the same place is none of a moving capture's sources; equal distances go by angle, then index.
    let row = [0.0, 0.0, 1.0, -1.0, 2.0].map(|x| turned(0.0, x));
    assert_eq!(
        neighbours(&row[0], Some(0), &row, &SourceOptions { min_distance: Some(0.5), ..options.clone() }),
        [2, 3, 4]
    );
    let mut spaced = row.to_vec();
    spaced.extend([3.0, 4.0, 5.0, 6.0].map(|x| turned(0.0, x)));
    let [least, _] = SourceFinder::new(&spaced, &options).distances();
    assert!((least - LEAST).abs() < 1e-12, "{least}");
    assert_eq!(neighbours(&spaced[0], Some(0), &spaced, &options)[..3], [2, 3, 4]);
    // Opposite and far views: the angle is a limit always, a distance only when given.
    let mut odd = spaced.clone();
    odd.push(turned(180.0, 0.5));
    odd.push(turned(0.0, 1_000.0));
    assert!(!neighbours(&odd[0], Some(0), &odd, &options).contains(&9));
    assert_eq!(neighbours(&odd[10], Some(10), &odd, &options), [8, 7, 6, 5]);
    let limited = SourceOptions { max_distance: Some(50.0), ..options };
    assert!(neighbours(&odd[10], Some(10), &odd, &limited).is_empty());
}

/// A real scene, for the test of this name.
fn scene(name: &str, test: &str) -> Option<Dataset> {
    let options = LoadOptions { eval: true, max_resolution: Some(64), ..LoadOptions::default() };
    Some(dataset::load(&shared(&format!("data/{name}"), test)?, &options).unwrap())
}

#[test]
fn golden_view_has_the_published_sources() {
    let Some(fox) = scene("fox", "fuse::sources::golden_view_has_the_published_sources") else {
        return;
    };
    for options in [absolute(), SourceOptions::default()] {
        let records = multi_view::records(&fox, &options);
        assert_eq!((records.len(), records[0].name.as_str()), (50, "0001.jpg"));
        assert_eq!(records[0].sources[..4], ["0002.jpg", "0006.jpg", "0003.jpg", "0004.jpg"]);
    }
}

#[test]
fn every_view_of_a_real_capture_has_enough_sources() {
    for name in ["fox", "fern", "fox_nerf"] {
        let Some(dataset) = scene(name, "fuse::sources::every_view_of_a_real_capture_has_enough_sources") else {
            continue;
        };
        let counts = |options: &SourceOptions| {
            let records = multi_view::records(&dataset, options);
            let mut counts: Vec<usize> = records.iter().map(|record| record.sources.len()).collect();
            counts.sort_unstable();
            counts
        };
        let (adaptive, published) = (counts(&SourceOptions::default()), counts(&absolute()));
        println!(
            "{name}: fewest and median sources {} {} adaptive, {} {} published",
            adaptive[0],
            adaptive[adaptive.len() / 2],
            published[0],
            published[published.len() / 2]
        );
        assert!(adaptive[0] >= 4, "{name}");
    }
    for options in [DemoOptions::small(), DemoOptions::large()] {
        let all = cameras(&options);
        let train: Vec<Camera> = (0..all.len()).filter(|i| i % 8 != 0).map(|i| all[i]).collect();
        let finder = SourceFinder::new(&train, &SourceOptions::default());
        let fewest = all.iter().step_by(8).map(|c| finder.neighbours(c, None).len()).min();
        println!("demo of {} views: {:?}, distances {:?}", all.len(), fewest, finder.distances());
        assert!(fewest >= Some(4));
    }
}
