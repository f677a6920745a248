//! Scores of all held-out views.

use super::fitted::{FittedView, fitted_sentence, write_fitted};
use super::{EvalError, Perceptual, Region, Score, ViewScores, score_view};
use crate::config::{Background, TrainConfig};
use crate::dataset::{Dataset, DatasetError, HostPhoto, Photo, Resolution, View};
use crate::gpu::{Gpu, GpuError};
use crate::output::cameras::Split;
use crate::output::pictures::{Output, Place};
use crate::output::results::{Protocol, Scored, ViewScore, means};
use crate::output::{OutputError, OutputFolder};
use crate::render::{Frame, Renderer};
use ibgs_data::first_of;
use std::sync::Arc;

/// Most views that a sentence names.
const NAMED: usize = 5;

/// The photo of a view that figures compare with: the photo of an object lies over the run's background.
///
/// # Errors
/// It cannot be decoded again.
pub fn compared(view: &View, config: &TrainConfig) -> Result<Arc<Photo>, DatasetError> {
    let photo = view.photo.pixels()?;
    Ok(match config.data.shows_object() {
        false => photo,
        true => Arc::new(photo.over(config.background())),
    })
}

/// Renders every held-out view and scores it, with a perceptual distance too if one is given. Pictures go into the
/// model folder if there is one. `report` is called with each view. A view whose photo is wholly masked has no scores
/// and does not count in the means.
///
/// # Errors
/// Not enough memory, the device is lost, a photo cannot be decoded again, or a picture cannot be written.
pub fn score_test_views(
    renderer: &Renderer,
    dataset: &Dataset,
    config: &TrainConfig,
    into: Option<(&OutputFolder, u32)>,
    perceptual: Option<&dyn Perceptual>,
    report: &mut dyn FnMut(&str, Option<&ViewScores>),
) -> Result<Scores, EvalError> {
    let mut scores = Scores::default();
    let views = || dataset.test.iter().map(|&index| &dataset.views[index]);
    for (number, view) in views().enumerate() {
        HostPhoto::decode_next(views().skip(number + 1).map(|view| &view.photo));
        let photo = compared(view, config)?;
        let view = &View { photo: photo.clone().into(), ..view.clone() };
        scores.with_masks += usize::from(photo.rgba.chunks_exact(4).any(|pixel| pixel[3] < 128));
        let (frame, scored) = match photo.is_wholly_masked() {
            true => (renderer.render(&view.camera)?, None),
            false => score_view(renderer, view, perceptual).map(|(frame, scored)| (frame, Some(scored)))?,
        };
        if let Some((folder, iteration)) = into {
            let place = Place { folder, split: Split::Test, iteration, name: &view.name };
            place.write_outputs(&frame, &Output::of(renderer))?;
            place.write_photo(&photo)?;
        }
        if let Some(glossy) = dataset.glossy {
            scores.add_regions(&frame, &photo, &glossy(&view.camera))?;
        }
        report(&view.name, scored.as_ref());
        let Some(scored) = scored else {
            scores.masked.push(view.name.clone());
            continue;
        };
        let named = |Score { psnr, aligned_psnr, ssim, lpips }: Score| ViewScore {
            name: view.name.clone(),
            psnr,
            aligned_psnr,
            ssim,
            lpips,
        };
        scores.base.push(named(scored.base));
        scores.image.extend(scored.image.map(named));
    }
    Ok(scores)
}

/// Scores of all held-out views.
#[derive(Clone, Debug, Default)]
pub struct Scores {
    /// Of the base images.
    pub base: Vec<ViewScore>,
    /// Of the final images; empty where the model has no network.
    pub image: Vec<ViewScore>,
    /// Views that have no score, as their photos are masked as a whole.
    pub masked: Vec<String>,
    /// Number of views whose photos have masked pixels, all or some.
    pub with_masks: usize,
    /// Where the scene's objects are known: base and final image on the glossy and mirror-like ones, then elsewhere.
    pub regions: Option<[[Region; 2]; 2]>,
    /// Apart from all others: the views from poses that were fitted to their photos, where that was asked for.
    pub fitted: Vec<FittedView>,
}

impl Scores {
    /// Writes them into the model folder.
    ///
    /// # Errors
    /// A file cannot be written, or is damaged.
    pub fn write(&self, folder: &OutputFolder, iteration: u32, protocol: &Protocol) -> Result<(), OutputError> {
        folder.write_results(iteration, Scored::Base, &self.base, protocol)?;
        if !self.image.is_empty() {
            folder.write_results(iteration, Scored::Final, &self.image, protocol)?;
        }
        write_fitted(&self.fitted, folder, iteration)
    }

    /// Errors on the glossy and mirror-like objects and elsewhere.
    fn add_regions(&mut self, frame: &Frame, photo: &Photo, glossy: &[bool]) -> Result<(), GpuError> {
        let regions = self.regions.get_or_insert_default();
        let images = [Some(frame.base()?), frame.image()?];
        for (place, wanted) in regions.iter_mut().zip([true, false]) {
            for (region, image) in place.iter_mut().zip(&images) {
                if let Some(image) = image {
                    region.add(image, photo, |i| glossy[i] == wanted);
                }
            }
        }
        Ok(())
    }

    /// `glossy objects: final 25.10 dB, base 23.00 dB; elsewhere: ...`, where the scene's objects are known.
    pub fn regions_sentence(&self) -> Option<String> {
        let [glossy, elsewhere] = self.regions?;
        let one = |[base, image]: [Region; 2]| match self.image.is_empty() {
            true => Some(format!("{:.2} dB", base.psnr()?)),
            false => Some(format!("final {:.2} dB, base {:.2} dB", image.psnr()?, base.psnr()?)),
        };
        Some(format!("glossy and mirror-like objects: {}; elsewhere: {}", one(glossy)?, one(elsewhere)?))
    }

    /// The mean scores from fitted poses, where there are such.
    pub fn fitted_sentence(&self) -> Option<String> {
        fitted_sentence(&self.fitted)
    }

    /// `2 held-out views have no score, as their photos are masked as a whole: a.png, b.png`, where there are such.
    pub fn masked_sentence(&self) -> Option<String> {
        let names = first_of(&self.masked, NAMED);
        match self.masked.len() {
            0 => None,
            1 => Some(format!("a held-out view has no score, as its photo is masked as a whole: {names}")),
            count => {
                Some(format!("{count} held-out views have no score, as their photos are masked as a whole: {names}"))
            }
        }
    }

    /// `PSNR 29.9 dB, SSIM 0.84`, of the base image too where there is a final one.
    pub fn sentence(&self) -> String {
        if self.base.is_empty() {
            return "no score".to_owned();
        }
        let one = |scores: &[ViewScore]| {
            let Score { psnr, ssim, .. } = means(scores);
            format!("PSNR {psnr:.3} dB, SSIM {ssim:.4}")
        };
        match self.image.is_empty() {
            true => one(&self.base),
            false => format!("final {}, base {}", one(&self.image), one(&self.base)),
        }
    }
}

/// What the figures of a run depend on.
pub fn protocol(config: &TrainConfig, dataset: &Dataset, gpu: &Gpu) -> Protocol {
    let resized = config.data.resolution != Resolution::default() || config.data.max_resolution.is_some();
    Protocol {
        resampler: match resized {
            true => format!("{}, or the scene's own reduced photos", config.data.resampler),
            false => "none".to_owned(),
        },
        factor: config.data.resolution.to_string(),
        split: format!("{} of {} views, listed in split.json", dataset.test.len(), dataset.views.len()),
        principal_point: config.data.principal_point.to_string(),
        masks: match config.data.shows_object() {
            false => "ignore".to_owned(),
            true => format!("object, photos over {}", config.background.unwrap_or(Background::BLACK)),
        },
        device: gpu.describe(),
        lpips: None,
    }
}
