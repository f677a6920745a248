//! Cameras that fit the observations of the scene, or were refined before: what a training with refined cameras begins with.

use super::BuildError;
use super::cameras::{adopted, some};
use glam::DVec3;
use ibgs_core::adjust::{Adjusted, Track, adjust, points};
use ibgs_core::camera::{Camera, usable_extent};
use ibgs_core::config::{PoseSwitch, TrainConfig};
use ibgs_core::dataset::{Dataset, DatasetError, HostPhoto, View, median_depth};
use ibgs_core::matching::adjust_to_photos;
use ibgs_core::output::{OutputError, cameras};
use ibgs_core::progress::Progress;
use ibgs_core::similarity::Similarity;
use std::collections::HashMap;
use std::path::Path;

/// The median error must fall to this part, or the cameras are left as they were loaded: they fit already.
const CLEAR: f64 = 0.6;
/// Pixels; a median error below is not worth an adjustment.
const NEGLIGIBLE: f64 = 0.1;
/// Radians that cameras must move by against those next to them, or else the logarithm that a focal length must change by: what
/// cameras that are right seem to be off by is less.
const ALONE: f64 = 8e-4;
const LENS: f64 = 6e-3;

/// Gives the views the cameras of a file, where the options name one. Otherwise adjusts them, where they are refined, to the
/// scene's tracks, or to what the photos have in common where it has none, if they then fit clearly better; with the points that
/// the tracks have. Other views move with the common frame and have the lens of their photos. A note says what came of it. The
/// options then say `auto`; where nothing could be compared `on` stays, which leaves it to the Gaussians, and `auto` becomes `off`.
///
/// # Errors
/// A file of the scene, or of the cameras, is damaged, or no longer there.
pub fn adjust_cameras(
    dataset: &mut Dataset,
    config: &mut TrainConfig,
    progress: &dyn Progress,
) -> Result<(), BuildError> {
    if let Some(path) = &config.poses.cameras {
        let cameras = given_cameras(dataset, path)?;
        let tracks = scene_tracks(dataset, config)?;
        let training: Vec<Camera> = dataset.train.iter().map(|&view| cameras[view]).collect();
        take(dataset, cameras, (&tracks, &points(&training, &tracks)));
        return Ok(());
    }
    if config.poses.refine == PoseSwitch::Off {
        return Ok(());
    }
    let given: Vec<Camera> = dataset.train.iter().map(|&view| dataset.views[view].camera).collect();
    let tracks = scene_tracks(dataset, config)?;
    let (what, adjusted) = if tracks.is_empty() {
        let photos: Vec<&HostPhoto> = dataset.train.iter().map(|&view| &dataset.views[view].photo).collect();
        ("places that photos have in common", adjust_to_photos(&given, &photos, progress)?)
    } else {
        ("observations of the scene's points", adjust(&given, &tracks).map(|adjusted| (adjusted, tracks)))
    };
    config.poses.refine = match (&adjusted, config.poses.refine) {
        (Err(_), PoseSwitch::Auto) => PoseSwitch::Off,
        (Err(_), given) => given,
        (Ok(_), _) => PoseSwitch::Auto,
    };
    let note = match adjusted {
        Err(why) => format!("cameras: not adjusted to {what}: {why}"),
        Ok((ref adjusted, _)) if !is_clear(&given, adjusted) => {
            let Adjusted { observations, errors: [before, after], .. } = adjusted;
            format!(
                "cameras: they fit {observations} {what}, with a median error of {before:.2} pixels, {after:.2} at best, and begin as \
                 they are"
            )
        }
        Ok((adjusted, tracks)) => {
            let note = sentence(dataset, &given, &adjusted, what);
            let loaded: Vec<Camera> = dataset.views.iter().map(|view| view.camera).collect();
            let cameras = adopted(&loaded, &dataset.train, &adjusted.cameras);
            take(dataset, cameras, (&tracks, &adjusted.points));
            note
        }
    };
    dataset.notes.push(note);
    Ok(())
}

/// Whether the adjusted cameras are clearly better.
fn is_clear(given: &[Camera], adjusted: &Adjusted) -> bool {
    let [before, after] = adjusted.errors;
    let lenses = given.iter().zip(&adjusted.cameras).map(|(from, to)| (to.focal / from.focal).map(f64::ln));
    let lens = lenses.map(|lens| lens.abs().max_element()).fold(0.0, f64::max);
    before >= NEGLIGIBLE && after <= CLEAR * before && (adjusted.alone > ALONE || lens > LENS)
}

/// What the photos have of the scene's points, where that is known.
fn scene_tracks(dataset: &Dataset, config: &TrainConfig) -> Result<Vec<Track>, DatasetError> {
    let are_known = config.source.is_some() || !dataset.made_tracks.is_empty();
    if are_known { dataset.tracks(&config.load_options()) } else { Ok(Vec::new()) }
}

/// The cameras that a file has for the views, in the size of their photos.
fn given_cameras(dataset: &Dataset, path: &Path) -> Result<Vec<Camera>, OutputError> {
    let records = cameras::read(path)?;
    let listed: HashMap<&str, Camera> = records.iter().map(|record| (&*record.name, record.camera)).collect();
    let camera = |view: &View| match listed.get(&*view.name) {
        Some(camera) => Ok(camera.resized(view.camera.width, view.camera.height)),
        None => {
            let reason = format!("it has no camera of the photo `{}`", view.name);
            Err(OutputError::Damaged { path: path.to_owned(), reason })
        }
    };
    dataset.views.iter().map(camera).collect()
}

/// Gives the views their cameras and the points of the tracks their places.
fn take(dataset: &mut Dataset, cameras: Vec<Camera>, (tracks, points): (&[Track], &[Option<DVec3>])) {
    dataset.loaded_checksum = Some(dataset.checksum());
    dataset.views.iter_mut().zip(cameras).for_each(|(view, camera)| view.camera = camera);
    let bits = |point: DVec3| point.to_array().map(f64::to_bits);
    let places = tracks.iter().zip(points).filter_map(|(track, point)| Some((bits(track.position?), (*point)?)));
    let places: HashMap<[u64; 3], DVec3> = places.collect();
    for point in &mut dataset.points {
        point.position = places.get(&bits(point.position)).copied().unwrap_or(point.position);
    }
}

/// What moved: `cameras: adjusted to 21000 observations of the scene's points, whose median error falls from 7.10 to 0.52 pixels ...`.
fn sentence(dataset: &Dataset, given: &[Camera], adjusted: &Adjusted, what: &str) -> String {
    let points: Vec<DVec3> = dataset.points.iter().map(|point| point.position).collect();
    let extent = usable_extent(dataset.space().scale);
    let count = given.len().max(1) as f64;
    let mut moved = [0.0; 3];
    for (from, to) in given.iter().zip(&adjusted.cameras) {
        let (angle, distance) = Similarity::IDENTITY.residual(from, to);
        let depth = median_depth(from, &points).unwrap_or(extent);
        let lens = (to.focal / from.focal - 1.0).abs().max_element();
        moved = [moved[0] + angle.to_degrees(), moved[1] + 100.0 * distance / depth, moved[2] + 100.0 * lens];
    }
    let [angle, distance, lens] = moved.map(|sum| sum / count);
    let [before, after] = adjusted.errors;
    let mut said = format!(
        "cameras: adjusted to {} {what}, whose median error falls from {before:.2} to {after:.2} pixels; \
         they move by {angle:.3} degrees and {distance:.3} % of their distance, focal lengths by {lens:.3} %, on average",
        adjusted.observations
    );
    let astray: Vec<&str> = adjusted.astray.iter().map(|&i| &*dataset.views[dataset.train[i]].name).collect();
    if !astray.is_empty() {
        said += &format!("; {} fit no others and keep their poses: {}", astray.len(), some(&astray));
    }
    said
}
