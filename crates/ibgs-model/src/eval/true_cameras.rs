//! Scores of held-out views at their true places, where those are known from another scene: that of a model whose cameras were off.
//!
//! A held-out camera of the model moves with the common frame of its training cameras, so its score also has the error of its own pose.
//! Here it stands where the true cameras have it, moved by the similarity that fits those of the training photos to the model's.

use super::scores::Scores;
use crate::camera::{Camera, scene_extent, usable_extent};
use crate::dataset::{Dataset, median_depth, thinned};
use crate::output::results::{ViewScore, means};
use crate::output::{OutputError, OutputFolder};
use crate::similarity::{CameraErrors, Similarity};
use glam::DVec3;
use ibgs_data::first_of;
use serde_json::{Map, Value, json};
use std::collections::HashMap;
use std::path::PathBuf;

/// File of these scores.
pub const TRUE_CAMERAS_FILE: &str = "results_true_cameras.json";

/// Most points that tell how far away is what a view shows.
const MOST_LOOKED_AT: usize = 20_000;

/// The true cameras are those of other photos.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{} has no cameras of {} of the model's {count} photos: {}", path.display(), names.len(), first_of(names, 3))]
pub struct OtherPhotos {
    /// The scene.
    pub path: PathBuf,
    /// Names of photos that it lacks.
    pub names: Vec<String>,
    /// Photos of the model.
    pub count: usize,
}

/// The held-out views of a model at their true places, in the model's frame.
#[derive(Clone, Debug)]
pub struct TrueCameras {
    /// The scene with the true cameras, and the model's split of it. Its held-out views are in the model's frame.
    pub dataset: Dataset,
    /// How far off the model's training cameras are.
    pub errors: CameraErrors,
}

impl TrueCameras {
    /// Fits the training cameras of the true scene to those that the views of the model's scene have now, and moves its held-out
    /// views so. Photos are told by their names.
    ///
    /// # Errors
    /// The true scene lacks a photo.
    pub fn new(model: &Dataset, mut truth: Dataset) -> Result<Self, OtherPhotos> {
        let places: HashMap<&str, usize> = truth.views.iter().enumerate().map(|(i, view)| (&*view.name, i)).collect();
        let used = || model.train.iter().chain(&model.test).map(|&view| &model.views[view].name);
        let names: Vec<String> = used().filter(|name| !places.contains_key(name.as_str())).cloned().collect();
        if !names.is_empty() {
            return Err(OtherPhotos { path: truth.path, names, count: used().count() });
        }
        let found = |views: &[usize]| views.iter().map(|&view| places[&*model.views[view].name]).collect();
        let (train, test): (Vec<usize>, Vec<usize>) = (found(&model.train), found(&model.test));
        let refined = model.train.iter().map(|&view| model.views[view].camera);
        let pairs: Vec<(Camera, Camera)> = train.iter().map(|&view| truth.views[view].camera).zip(refined).collect();
        let points: Vec<DVec3> = thinned(&truth.points, MOST_LOOKED_AT).iter().map(|point| point.position).collect();
        let extent = usable_extent(scene_extent(truth.views.iter().map(|view| &view.camera)).1);
        let frame = Similarity::fit(&pairs);
        let errors = frame.errors(&pairs, |camera| median_depth(camera, &points).unwrap_or(extent));
        for &view in &test {
            let camera = &mut truth.views[view].camera;
            *camera = frame.camera(camera);
        }
        Ok(Self { dataset: Dataset { train, test, glossy: None, ..truth }, errors })
    }

    /// The mean scores there in a sentence; none without any.
    pub fn sentence(&self, scores: &Scores) -> Option<String> {
        let psnr = |scores: &[ViewScore]| (!scores.is_empty()).then(|| means(scores).psnr);
        let base = psnr(&scores.base)?;
        let image = psnr(&scores.image).map_or_else(String::new, |psnr| format!("final {psnr:.3} dB, "));
        let CameraErrors { degrees, distance, focal } = self.errors;
        Some(format!(
            "PSNR_true_cameras, held-out views where {} has their cameras: {image}base {base:.3} dB; training cameras miss theirs by \
             {degrees:.3} degrees, {distance:.3} % of their distance and {focal:.3} % of the focal length, on average",
            self.dataset.path.display()
        ))
    }

    /// Writes the scores there into the model folder.
    ///
    /// # Errors
    /// A file cannot be written, or is damaged.
    pub fn write(&self, scores: &Scores, folder: &OutputFolder, iteration: u32) -> Result<(), OutputError> {
        let named = |psnr: f64, ssim: f64| json!({ "PSNR_true_cameras": psnr, "SSIM_true_cameras": ssim });
        let of = |scores: &[ViewScore]| {
            let view = |score: &ViewScore| (score.name.clone(), named(score.psnr, score.ssim));
            let mut value = named(means(scores).psnr, means(scores).ssim);
            value["by_view"] = Value::Object(scores.iter().map(view).collect::<Map<_, _>>());
            (!scores.is_empty()).then_some(value)
        };
        let CameraErrors { degrees, distance, focal } = self.errors;
        let value = json!({
            "cameras": self.dataset.path,
            "base": of(&scores.base),
            "final": of(&scores.image),
            "views": scores.base.len(),
            "training_cameras": { "degrees": degrees, "percent_of_distance": distance, "percent_of_focal_length": focal },
        });
        folder.write_result(iteration, TRUE_CAMERAS_FILE, value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera_change::CameraChange;
    use glam::DMat3;
    use ibgs_testing::tiny_demo;

    fn demo() -> Dataset {
        let cache = tempfile::tempdir().unwrap();
        ibgs_demo::load(&tiny_demo(), Some(cache.path()), &()).unwrap()
    }

    fn frame() -> Similarity {
        let rotation = DMat3::from_rotation_z(1.2) * DMat3::from_rotation_x(0.3);
        Similarity { scale: 1.8, rotation, translation: DVec3::new(2.0, -1.0, 0.5) }
    }

    /// The demo in another frame, its cameras changed, without the photo of one number, and sorted the other way round.
    fn off(change: impl Fn(usize) -> CameraChange, without: Option<usize>) -> Dataset {
        let mut model = demo();
        for (number, view) in model.views.iter_mut().enumerate() {
            view.camera = frame().camera(&view.camera).changed(&change(number));
        }
        model.views.reverse();
        let last = model.views.len() - 1;
        model.train.iter_mut().chain(&mut model.test).for_each(|view| *view = last - *view);
        model.train.retain(|&view| Some(last - view) != without);
        model
    }

    #[test]
    fn held_out_cameras_stand_where_the_true_ones_are() {
        let still = off(|_| CameraChange::default(), Some(3));
        let truth = demo();
        let exact = TrueCameras::new(&still, truth.clone()).unwrap();
        for (&view, &place) in exact.dataset.test.iter().zip(&still.test) {
            let (found, expected) = (exact.dataset.views[view].camera, still.views[place].camera);
            assert_eq!(exact.dataset.views[view].name, still.views[place].name);
            assert!(found.translation.abs_diff_eq(expected.translation, 1e-9), "{found:?}");
            assert!(found.view_from_world.abs_diff_eq(expected.view_from_world, 1e-9), "{found:?}");
        }
        assert_eq!((exact.dataset.test.len(), exact.dataset.train.len()), (2, 7));
        let CameraErrors { degrees, distance, focal } = exact.errors;
        assert!(degrees < 1e-5 && distance < 1e-6 && focal < 1e-9, "{:?}", exact.errors);

        // Errors of training cameras, those of held-out ones do not matter.
        let way =
            |i: usize| DVec3::new((2.4 * i as f64).sin(), (2.4 * i as f64).cos(), (1.1 * i as f64).sin()).normalize();
        let change = |i: usize| CameraChange {
            rotation: way(i) * if i.is_multiple_of(8) { 0.5 } else { 0.5_f64.to_radians() },
            focal: glam::DVec2::splat(0.03 * truth.views[i].camera.focal.x),
            ..CameraChange::default()
        };
        let turned = TrueCameras::new(&off(change, None), truth.clone()).unwrap();
        let CameraErrors { degrees, focal, .. } = turned.errors;
        assert!((0.3..0.6).contains(&degrees) && (focal - 3.0).abs() < 1e-6, "{:?}", turned.errors);
        for &view in &turned.dataset.test {
            let expected = frame().camera(&truth.views[view].camera);
            let (angle, _) = Similarity::IDENTITY.residual(&expected, &turned.dataset.views[view].camera);
            assert!(angle.to_degrees() < 0.5, "the common frame alone: {angle}");
            assert_eq!(turned.dataset.views[view].camera.focal, truth.views[view].camera.focal);
        }
    }

    #[test]
    fn a_scene_without_the_photos_is_refused() {
        let mut truth = demo();
        truth.views.truncate(7);
        let error = TrueCameras::new(&off(|_| CameraChange::default(), None), truth.clone()).unwrap_err();
        let path = truth.path.display();
        let said =
            format!("{path} has no cameras of 3 of the model's 10 photos: view_007.png, view_009.png, view_008.png");
        assert_eq!(error.to_string(), said);
    }
}
