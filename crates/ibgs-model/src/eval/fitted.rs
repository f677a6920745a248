//! Scores of held-out views after the camera of each is fitted to its own photo.
//!
//! Such a score uses the photo that it is compared with, so it is no measure of a new view. It says how much of an error is that of the
//! held-out camera's pose. It stands apart, under a name of its own.

use super::fit_pose::{Colors, fit_pose};
use super::scores::compared;
use super::{EvalError, Score, ViewScores, score_view};
use crate::camera::{Camera, scene_extent, usable_extent};
use crate::config::TrainConfig;
use crate::dataset::{Dataset, HostPhoto, View, median_depth, thinned};
use crate::output::{OutputError, OutputFolder};
use crate::render::Renderer;
use crate::similarity::Similarity;
use glam::DVec3;
use serde_json::{Map, Value, json};

/// File of these scores.
pub const FITTED_POSES_FILE: &str = "results_fitted_poses.json";

/// Most points that tell how far away is what a view shows.
const MOST_LOOKED_AT: usize = 20_000;

/// A held-out view whose camera was fitted to its photo.
#[derive(Clone, Debug, PartialEq)]
pub struct FittedView {
    /// Image name.
    pub name: String,
    /// With the fitted pose, or the given one where that has the higher PSNR.
    pub camera: Camera,
    /// Scores of its images from there.
    pub scores: ViewScores,
    /// Angle between the two poses in radians.
    pub angle: f64,
    /// Distance between the two, as a part of that to what the view shows.
    pub distance: f64,
    /// PSNR gained by the fit, in dB; 0 where the given pose is kept.
    pub gained: f64,
}

impl FittedView {
    /// Score of the image that the pose was fitted by: the final one, where there is a network.
    fn fitted(&self) -> Score {
        self.scores.image.unwrap_or(self.scores.base)
    }
}

/// Fits the camera of every held-out view to its photo and scores the view from there. A view whose photo is wholly masked is left
/// out. `report` is called with each view.
///
/// # Errors
/// Not enough memory, the device is lost, or a photo cannot be decoded again.
pub fn fitted_views(
    renderer: &Renderer,
    dataset: &Dataset,
    config: &TrainConfig,
    report: &mut dyn FnMut(&str),
) -> Result<Vec<FittedView>, EvalError> {
    let points: Vec<DVec3> = thinned(&dataset.points, MOST_LOOKED_AT).iter().map(|point| point.position).collect();
    let extent = usable_extent(scene_extent(dataset.views.iter().map(|view| &view.camera)).1);
    let colors = if renderer.exposure().is_some() { Colors::Fitted } else { Colors::Fixed };
    let views = || dataset.test.iter().map(|&index| &dataset.views[index]);
    let mut all = Vec::new();
    for (number, view) in views().enumerate() {
        HostPhoto::decode_next(views().skip(number + 1).map(|view| &view.photo));
        report(&view.name);
        let photo = compared(view, config)?;
        if photo.is_wholly_masked() {
            continue;
        }
        let length = median_depth(&view.camera, &points).unwrap_or(extent);
        let camera = fit_pose(renderer, (&view.camera, &photo), length, colors)?;
        let at = |camera: Camera| -> Result<FittedView, EvalError> {
            let seen = View { camera, photo: photo.clone().into(), ..view.clone() };
            let (_, scores) = score_view(renderer, &seen, None)?;
            let (angle, distance) = Similarity::IDENTITY.residual(&view.camera, &camera);
            Ok(FittedView { name: view.name.clone(), camera, scores, angle, distance: distance / length, gained: 0.0 })
        };
        let (fitted, given) = (at(camera)?, at(view.camera)?);
        let gained = fitted.fitted().psnr - given.fitted().psnr;
        all.push(if gained > 0.0 { FittedView { gained, ..fitted } } else { given });
    }
    Ok(all)
}

/// Means over views.
struct Means {
    base: [f64; 2],
    image: Option<[f64; 2]>,
    angle: f64,
    distance: f64,
}

impl Means {
    /// None without any.
    fn of(views: &[FittedView]) -> Option<Self> {
        let mean = |value: &dyn Fn(&FittedView) -> f64| views.iter().map(value).sum::<f64>() / views.len() as f64;
        let has_final = views.first()?.scores.image.is_some();
        Some(Self {
            base: [mean(&|view| view.scores.base.psnr), mean(&|view| view.scores.base.ssim)],
            image: has_final.then(|| [mean(&|view| view.fitted().psnr), mean(&|view| view.fitted().ssim)]),
            angle: mean(&|view| view.angle).to_degrees(),
            distance: 100.0 * mean(&|view| view.distance),
        })
    }
}

/// The means in a sentence: `each held-out camera fitted to its own photo: PSNR_fitted_pose ...`; none without views.
pub fn fitted_sentence(views: &[FittedView]) -> Option<String> {
    let Means { base, image, angle, distance } = Means::of(views)?;
    let image = image.map_or_else(String::new, |[psnr, _]| format!("final {psnr:.3} dB, "));
    Some(format!(
        "PSNR_fitted_pose, no measure of new views: each held-out camera is fitted to its own photo, by {angle:.3} degrees and \
         {distance:.3} % of its distance on average: {image}base {:.3} dB",
        base[0]
    ))
}

/// Writes the scores of all views and their means into the model folder; nothing without views.
///
/// # Errors
/// A file cannot be written, or is damaged.
pub fn write_fitted(views: &[FittedView], folder: &OutputFolder, iteration: u32) -> Result<(), OutputError> {
    let Some(Means { base, image, angle, distance }) = Means::of(views) else { return Ok(()) };
    let named = |[psnr, ssim]: [f64; 2]| json!({ "PSNR_fitted_pose": psnr, "SSIM_fitted_pose": ssim });
    let scored = |score: Score| named([score.psnr, score.ssim]);
    let view = |view: &FittedView| {
        let value = json!({
            "base": scored(view.scores.base),
            "final": view.scores.image.map(scored),
            "degrees": view.angle.to_degrees(),
            "percent_of_distance": 100.0 * view.distance,
        });
        (view.name.clone(), value)
    };
    let value = json!({
        "base": named(base),
        "final": image.map(named),
        "degrees": angle,
        "percent_of_distance": distance,
        "views": views.len(),
        "by_view": Value::Object(views.iter().map(view).collect::<Map<_, _>>()),
    });
    folder.write_result(iteration, FITTED_POSES_FILE, value)
}
