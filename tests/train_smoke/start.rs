//! What a training begins with: points that cameras see, points found in the photos, exposures by evidence.

use super::{dataset, plain, trainer};
use crate::common::{gpu, rasterizer};
use glam::DVec3;
use ibgs_core::config::{ExposureSwitch, TrainConfig};
use ibgs_core::dataset::{Dataset, InitialPoints, Point, PointsFrom, demo, unrelated_colors};
use ibgs_core::sources::sweep;
use ibgs_train::{TrainError, Trainer, find_points, settle_exposure};
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

/// Share of the points that lie within this part of their distance from the surface that a training camera sees there.
fn on_surface(dataset: &Dataset, points: &[Point], part: f64) -> f64 {
    let views: Vec<_> = dataset.train.iter().map(|&view| dataset.views[view].camera).collect();
    let truths: Vec<_> = views.iter().map(demo::truth).collect();
    let near = |point: &&Point| {
        views.iter().zip(&truths).any(|(camera, truth)| {
            let (at, depth) = camera.project(point.position);
            let inside = depth > 0.0
                && (0.0..f64::from(camera.width)).contains(&at.x)
                && (0.0..f64::from(camera.height)).contains(&at.y);
            let pixel = at.y.max(0.0) as usize * camera.width as usize + at.x.max(0.0) as usize;
            inside && (f64::from(truth.depth[pixel]) / depth - 1.0).abs() < part
        })
    };
    points.iter().filter(near).count() as f64 / points.len() as f64
}

#[test]
fn points_are_found_in_the_photos() {
    let mut dataset = dataset();
    let config = TrainConfig { ..plain(5) };
    dataset.points_from = PointsFrom::Chance;
    let chance = dataset.clone();
    find_points(&gpu(), &mut dataset, &config, &()).unwrap();
    println!("{:?}", dataset.notes);
    assert_eq!(dataset.points_from, PointsFrom::Photos);
    let share = on_surface(&dataset, &dataset.points, 0.05);
    println!("{} points, {:.0} % of them on the surface", dataset.points.len(), 100.0 * share);
    assert!(share > 0.8, "{share}");
    assert!(dataset.notes.last().unwrap().contains("replace the random ones"));
    // The same again, and never more than asked for.
    let some = sweep::points(&gpu(), &chance, 600, &()).unwrap();
    let again = sweep::points(&gpu(), &chance, 600, &()).unwrap();
    let places = |points: &[Point]| points.iter().map(|point| point.position.to_array()).collect::<Vec<_>>();
    assert_eq!((some.len(), places(&some)), (600, places(&again)));
    // A scene's own points stay as they are on a software adapter, and where they alone are asked for.
    let mut own = Dataset { points_from: PointsFrom::Scene, ..chance };
    let count = own.points.len();
    let mut alone = config.clone();
    alone.data.initial_points = InitialPoints::Scene;
    find_points(&gpu(), &mut own, if gpu().is_software() { &config } else { &alone }, &()).unwrap();
    assert_eq!((own.points.len(), own.points_from), (count, PointsFrom::Scene));
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
        assert_eq!(settle_exposure(&raster, &dataset(), &mut config).unwrap(), None);
        assert_eq!(config.exposure.enabled, settled);
    }
}
