//! Whether a scene's photos need corrected exposures, by evidence: two short trainings of the base alone on reduced photos leave the
//! same photos out, one with exposures and one without. Shading that turns with the camera looks like exposure in the photos that
//! are trained, but only real exposures make photos that were left out better known.

use crate::step::TrainError;
use crate::trial::Trial;
use ibgs_core::config::{ExposureSwitch, TrainConfig};
use ibgs_core::dataset::Dataset;
use ibgs_core::eval::scores::score_test_views;
use ibgs_core::exposure::ExposureField;
use ibgs_core::output::results::means;
use ibgs_core::raster::Rasterizer;
use ibgs_core::render::Renderer;
use std::fmt;
use std::sync::Arc;

/// Every so many training photos one is left out, but not many more than enough.
const EVERY: usize = 4;
const ENOUGH_LEFT_OUT: usize = 24;
/// What corrected exposures must gain on the photos that were left out, in dB.
const LEAST_GAIN: f64 = 0.1;
/// Where exposures differ by more than this (root mean square of the log gains), they must only lose no more than two equal trainings
/// may differ by.
const CLEAR_SPREAD: f64 = 0.035;
const NOISE: f64 = 0.15;

/// Mean PSNR of the photos that were left out, in dB, and how much exposures differ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExposureEvidence {
    /// Exposures corrected, those of these photos predicted from the others.
    pub predicted: f64,
    /// The same model, with the mean exposure for all of them.
    pub levelled: f64,
    /// Exposures not corrected.
    pub without: f64,
    /// Root mean square of the learned log gains.
    pub spread: f64,
}

impl ExposureEvidence {
    /// Whether exposures are worth correcting: predictions hold for photos that nobody has seen, and the model is better for it or,
    /// where exposures clearly differ, not worse.
    pub fn favours_correction(&self) -> bool {
        let least = if self.spread > CLEAR_SPREAD { -NOISE } else { LEAST_GAIN };
        self.predicted > self.levelled && self.predicted >= self.without + least
    }
}

impl fmt::Display for ExposureEvidence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { predicted, levelled, without, spread } = self;
        let verdict = if self.favours_correction() { "corrected" } else { "not corrected" };
        write!(
            f,
            "exposure: {verdict}; in a trial the photos differ by {:.1} %; photos that it left out have {predicted:.2} dB with predicted \
             exposures, {levelled:.2} dB with none, {without:.2} dB from a model without",
            100.0 * spread
        )
    }
}

/// Resolves `exposure.enabled = "auto"`: `on` or `off`. None where there is no trial: in short runs, with few photos, and on a
/// software adapter, where it would take minutes.
///
/// # Errors
/// Not enough memory, the device is lost, a photo cannot be decoded again.
pub fn resolve(
    raster: &Arc<Rasterizer>,
    dataset: &Dataset,
    config: &mut TrainConfig,
) -> Result<Option<ExposureEvidence>, TrainError> {
    if config.exposure.enabled != ExposureSwitch::Auto {
        return Ok(None);
    }
    config.exposure.enabled = ExposureSwitch::Off;
    if !Trial::is_worth_it(raster, dataset, config) {
        return Ok(None);
    }
    let evidence = trial(raster, dataset, config)?;
    if evidence.favours_correction() {
        config.exposure.enabled = ExposureSwitch::On;
    }
    Ok(Some(evidence))
}

fn trial(raster: &Arc<Rasterizer>, dataset: &Dataset, config: &TrainConfig) -> Result<ExposureEvidence, TrainError> {
    let every = EVERY.max(dataset.train.len() / ENOUGH_LEFT_OUT);
    let trial = Trial::new(raster, dataset, config, every)?;
    let psnr = |renderer: &Renderer, config: &TrainConfig| -> Result<f64, TrainError> {
        let scores = score_test_views(renderer, &trial.small, config, None, None, &mut |_, _| {})?;
        Ok(means(&scores.base).psnr)
    };
    let trained = |exposure: ExposureSwitch| trial.trained(|config| config.exposure.enabled = exposure);
    let without = {
        let (trainer, config) = trained(ExposureSwitch::Off)?;
        psnr(&trainer.renderer()?, &config)?
    };
    let (trainer, config) = trained(ExposureSwitch::On)?;
    let predicted = psnr(&trainer.renderer()?, &config)?;
    let field = trainer.exposure()?;
    let spread = field.as_ref().map_or(0.0, ExposureField::spread);
    let levelled = field.map(ExposureField::levelled);
    let levelled = psnr(&trainer.renderer()?.with_exposure(levelled), &config)?;
    Ok(ExposureEvidence { predicted, levelled, without, spread })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn evidence_decides() {
        let favours = |spread, predicted, levelled, without| {
            ExposureEvidence { predicted, levelled, without, spread }.favours_correction()
        };
        assert!(favours(0.05, 31.9, 27.3, 31.0), "automatic exposure");
        assert!(favours(0.06, 22.0, 21.0, 22.1), "exposures clearly differ, and the noise hides the gain");
        assert!(!favours(0.055, 30.5, 28.1, 30.9), "shading");
        assert!(!favours(0.025, 32.4, 31.4, 32.37), "no gain");
        assert!(!favours(0.05, 30.0, 30.1, 29.0), "predictions say nothing");
    }
}
