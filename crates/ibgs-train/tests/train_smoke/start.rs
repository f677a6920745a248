//! What a training begins with: points that cameras see, points found in the photos, exposures by evidence.

use super::dataset;
use crate::small::{plain, trainer};
use glam::{DMat3, DVec2, DVec3};
use ibgs_core::camera::Camera;
use ibgs_core::config::ExposureSwitch;
use ibgs_core::dataset::{Dataset, InitialPoints, Masks, Point, PointsFrom, View, unrelated_colors};
use ibgs_core::sources::sweep;
use ibgs_reference::gpu::{gpu, rasterizer};
use ibgs_reference::plane_sweep::wall_photo;
use ibgs_train::{TrainError, Trainer, find_points, resolve_exposure};
use std::sync::Arc;

fn moved(dataset: &Dataset, place: impl Fn(DVec3) -> DVec3) -> Dataset {
    let mut dataset = dataset.clone();
    dataset.points.iter_mut().for_each(|point| point.position = place(point.position));
    dataset
}

#[test]
fn points_that_no_camera_sees_are_refused_before_the_first_iteration() {
    let (dataset, config) = (dataset(), plain(5));
    let begun = |dataset: &Dataset| Trainer::new(Arc::new(rasterizer()), dataset, &config);
    let error = begun(&moved(&dataset, |place| place + 1_000.0)).err().expect("nothing to see");
    assert!(matches!(error, TrainError::Unseen { shown: 0, all: 300, what: "points" }), "{error}");
    let text = error.to_string();
    assert!(text.contains("show 0 of the 300 points") && text.contains("other coordinates"), "{text}");
    // The same for Gaussians to begin with.
    let mut start = trainer(&dataset, &config).splats().download(&gpu()).unwrap();
    start.means.iter_mut().for_each(|mean| mean[0] += 1e4);
    let error = Trainer::from_gaussians(Arc::new(rasterizer()), &dataset, &config, &start).err().expect("far away");
    assert!(error.to_string().contains("show 0 of the 300 Gaussians"), "{error}");
    // Nine of ten astray are a start still.
    let mut few = dataset.clone();
    few.points.iter_mut().skip(30).for_each(|point| point.position += 1_000.0);
    assert!(begun(&few).is_ok());
}

#[test]
fn colours_that_fit_no_photo_are_told() {
    let dataset = dataset();
    assert_eq!(unrelated_colors(&dataset).unwrap(), None);
    let turned = moved(&dataset, |place| DVec3::new(-place.x, place.y, -place.z));
    let mut shuffled = dataset.clone();
    let colors: Vec<[u8; 3]> = dataset.points.iter().map(|point| point.color).collect();
    for (i, point) in shuffled.points.iter_mut().enumerate() {
        point.color = colors[(i * 97 + 41) % colors.len()];
    }
    for (what, wrong) in [("turned", turned), ("shuffled", shuffled)] {
        let warning = unrelated_colors(&wrong).unwrap();
        assert!(warning.is_some_and(|text| text.contains("no better than chance")), "{what}");
    }
    // Points without colours say nothing.
    let mut grey = moved(&dataset, |place| -place);
    grey.points.iter_mut().for_each(|point| point.color = [128; 3]);
    assert_eq!(unrelated_colors(&grey).unwrap(), None);
}

/// Eight photos of a textured wall, from a ring of places in front of it, with a random point.
fn wall() -> Dataset {
    let view = |i: u32| {
        let angle = 0.785 * f64::from(i);
        let place = DVec3::new(1.5 * angle.cos(), 1.0 * angle.sin(), 0.3 * (2.0 * angle).cos());
        let view_from_world = DMat3::from_rotation_y(0.2 * place.x);
        let camera = Camera {
            width: 72,
            height: 54,
            focal: DVec2::splat(70.0),
            principal: DVec2::new(36.0, 27.0),
            view_from_world,
            translation: -(view_from_world * place),
        };
        View { name: format!("{i}.png"), camera, photo: wall_photo(&camera, SLOPE).into() }
    };
    Dataset {
        path: "wall".into(),
        views: (0..8).map(view).collect(),
        train: (0..8).collect(),
        test: Vec::new(),
        points: vec![Point { position: DVec3::Z, color: [0; 3] }],
        points_from: PointsFrom::Chance,
        extent: None,
        masks: Masks::Ignore,
        backdrop: None,
        glossy: None,
        made_tracks: Default::default(),
        loaded_checksum: None,
        notes: Vec::new(),
    }
}

const SLOPE: f64 = 0.3;

#[test]
fn points_are_found_in_the_photos() {
    let mut dataset = wall();
    find_points(&gpu(), &mut dataset, &plain(5), &()).unwrap();
    println!("{:?}", dataset.notes);
    assert_eq!(dataset.points_from, PointsFrom::Photos);
    assert!(dataset.notes.last().unwrap().contains("replace the random ones"));
    let error = |point: &Point| (point.position.z / (4.0 + SLOPE * point.position.x) - 1.0).abs();
    let near = dataset.points.iter().filter(|point| error(point) < 0.02).count();
    println!("{near} of {} points within 2 % of the wall", dataset.points.len());
    assert!(near * 10 > dataset.points.len() * 9, "{near} of {}", dataset.points.len());
    // The same again, and never more than asked for.
    let some = || sweep::points(&gpu(), &wall(), 600, &()).unwrap();
    let places = |points: &[Point]| points.iter().map(|point| point.position.to_array()).collect::<Vec<_>>();
    let first = some();
    assert_eq!((first.len(), places(&first)), (600, places(&some())));
}

#[test]
fn a_scene_may_begin_with_its_own_points_alone() {
    let own = Dataset { points_from: PointsFrom::Scene, ..wall() };
    let mut alone = plain(5);
    alone.data.initial_points = InitialPoints::Scene;
    let mut object = plain(5);
    object.data.masks = Some(Masks::Object);
    // On a software adapter also where nothing is asked for.
    let usual = plain(5);
    for config in [Some(&alone), Some(&object), gpu().is_software().then_some(&usual)].into_iter().flatten() {
        let mut dataset = own.clone();
        find_points(&gpu(), &mut dataset, config, &()).unwrap();
        assert_eq!((dataset.points.len(), dataset.points_from), (1, PointsFrom::Scene));
    }
}

#[test]
fn short_runs_make_no_trial_of_exposures() {
    let raster = Arc::new(rasterizer());
    for (switch, settled) in [
        (ExposureSwitch::Auto, ExposureSwitch::Off),
        (ExposureSwitch::On, ExposureSwitch::On),
        (ExposureSwitch::Off, ExposureSwitch::Off),
    ] {
        let mut config = plain(200);
        config.exposure.enabled = switch;
        assert_eq!(resolve_exposure(&raster, &dataset(), &mut config).unwrap(), None);
        assert_eq!(config.exposure.enabled, settled);
    }
}
