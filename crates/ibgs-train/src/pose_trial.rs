//! Whether a scene's cameras are worth refining, by evidence: a short training of the base alone on reduced photos leaves some out,
//! whose cameras are then fitted to their photos in its model. Cameras that are right hardly move. Those that are off do, and show
//! their photos clearly better from where they come to lie, though nothing has learned from these.

use crate::step::TrainError;
use crate::trial::{LONGEST, Trial};
use glam::DVec3;
use ibgs_core::camera::Camera;
use ibgs_core::config::{PoseSwitch, TrainConfig};
use ibgs_core::dataset::Dataset;
use ibgs_core::eval::fitted::fitted_views;
use ibgs_core::median;
use ibgs_core::raster::Rasterizer;
use std::fmt;
use std::sync::Arc;

/// Every so many training photos one is left out, but not more than the most.
const EVERY: usize = 8;
const MOST_LEFT_OUT: usize = 8;
/// Pixels of the reduced photos that the cameras must move by: about 0.1 degrees, which is what refinement itself leaves.
const LEAST_MOVED: f64 = 1.0;
/// What their photos must gain by it, in dB.
const LEAST_GAIN: f64 = 0.5;

/// What the photos that were left out say of their cameras, each as the median of all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseEvidence {
    /// Pixels of the reduced photos that the scene's points move by when a camera is fitted to its photo.
    pub moved: f64,
    /// PSNR gained by that, in dB.
    pub gained: f64,
    /// Photos that were left out.
    pub photos: usize,
}

impl PoseEvidence {
    /// Whether cameras are worth refining.
    pub fn favours_refinement(&self) -> bool {
        self.moved >= LEAST_MOVED && self.gained >= LEAST_GAIN
    }
}

impl fmt::Display for PoseEvidence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { moved, gained, photos } = self;
        let verdict = if self.favours_refinement() { "refined" } else { "not refined" };
        write!(
            f,
            "cameras: {verdict}; in a trial, those of {photos} photos that it left out move by {moved:.2} pixels of {LONGEST} when they \
             are fitted, and gain {gained:.2} dB"
        )
    }
}

/// Resolves `poses.refine = "auto"` where no observations decide: `on` or `off`. None where there is no trial; the cameras are then
/// left as they are.
///
/// # Errors
/// Not enough memory, the device is lost, a photo cannot be decoded again.
pub fn resolve(
    raster: &Arc<Rasterizer>,
    dataset: &Dataset,
    config: &mut TrainConfig,
) -> Result<Option<PoseEvidence>, TrainError> {
    if config.poses.refine != PoseSwitch::Auto {
        return Ok(None);
    }
    config.poses.refine = PoseSwitch::Off;
    if !Trial::is_worth_it(raster, dataset, config) {
        return Ok(None);
    }
    let every = EVERY.max(dataset.train.len().div_ceil(MOST_LEFT_OUT));
    let trial = Trial::new(raster, dataset, config, every)?;
    let exposure = config.exposure.enabled;
    let evidence = evidence(&trial, |config| config.exposure.enabled = exposure)?;
    if evidence.favours_refinement() {
        config.poses.refine = PoseSwitch::On;
    }
    Ok(Some(evidence))
}

fn evidence(trial: &Trial, change: impl FnOnce(&mut TrainConfig)) -> Result<PoseEvidence, TrainError> {
    let (trainer, config) = trial.trained(change)?;
    let (renderer, small) = (trainer.renderer()?, &trial.small);
    let points: Vec<DVec3> = small.points.iter().map(|point| point.position).collect();
    let (mut moved, mut gained) = (Vec::new(), Vec::new());
    for fitted in fitted_views(&renderer, small, &config, &mut |_| {})? {
        let Some(view) = small.views.iter().find(|view| view.name == fitted.name) else { continue };
        moved.push(movement(&view.camera, &fitted.camera, &points));
        gained.push(fitted.gained);
    }
    let photos = moved.len();
    Ok(PoseEvidence { moved: middle(moved), gained: middle(gained), photos })
}

/// Pixels that the points move by in a camera's image, the median of those that it shows; 0 where it shows none.
fn movement(from: &Camera, to: &Camera, points: &[DVec3]) -> f64 {
    let moved = |point: &DVec3| Some(from.seen(*point)?.0.distance(to.project(*point).0));
    middle(points.iter().filter_map(moved).collect())
}

/// 0 of nothing.
fn middle(values: Vec<f64>) -> f64 {
    median(values).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ibgs_core::camera_change::CameraChange;
    use ibgs_demo::DemoOptions;
    use ibgs_reference::gpu::rasterizer;

    #[test]
    fn cameras_must_move_and_gain() {
        let favours = |moved, gained| PoseEvidence { moved, gained, photos: 8 }.favours_refinement();
        assert!(favours(2.6, 2.0));
        assert!(!favours(0.3, 2.0) && !favours(2.6, 0.1) && !favours(0.0, 0.0) && !favours(f64::NAN, f64::NAN));
        assert_eq!((middle(vec![]), middle(vec![3.0, 1.0, 2.0])), (0.0, 2.0));
    }

    /// The tiny demo with every camera turned, about another axis each.
    fn turned(mut dataset: Dataset, degrees: f64) -> Dataset {
        for (i, view) in dataset.views.iter_mut().enumerate() {
            let way = DVec3::new((2.4 * i as f64).sin(), (2.4 * i as f64).cos(), (1.1 * i as f64).sin()).normalize();
            let change = CameraChange { rotation: way * degrees.to_radians(), ..CameraChange::default() };
            view.camera = view.camera.changed(&change);
        }
        dataset
    }

    #[test]
    fn a_trial_tells_cameras_that_are_off_from_those_that_are_right() {
        let cache = tempfile::tempdir().unwrap();
        let options = DemoOptions { views: 32, ..ibgs_testing::tiny_demo() };
        let demo = ibgs_demo::load(&options, Some(cache.path()), &()).unwrap();
        let raster = Arc::new(rasterizer());
        let tried = |dataset: &Dataset| {
            let trial = Trial::new(&raster, dataset, &TrainConfig::default(), EVERY).unwrap();
            assert_eq!((trial.small.test.len(), trial.small.train.len()), (3, 25));
            evidence(&trial, |config| config.iterations = Some(300)).unwrap()
        };
        // 4 degrees are two pixels of these small photos, as 0.25 degrees are of those of a trial.
        let [right, off] = [0.0, 4.0].map(|degrees| tried(&turned(demo.clone(), degrees)));
        println!("{right}\n{off}");
        assert!(!right.favours_refinement() && off.favours_refinement(), "{right:?} {off:?}");
        assert!(off.moved > 2.0 * right.moved, "{right:?} {off:?}");
    }
}
