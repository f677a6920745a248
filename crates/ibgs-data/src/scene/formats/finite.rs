//! Gaussians with NaN, with infinity or without a rotation are left out of what a file holds.
//!
//! Two infinities are no damage: the logit of an opacity of 0 or 1, and the logarithm of a scale of 0. They become the
//! outermost finite values.

use super::super::{Gaussians, PerGaussian, SceneError};
use super::quantise;
use std::path::Path;

/// What messages call the kinds of parameters.
const WORDS: PerGaussian<&str> = PerGaussian {
    means: "position",
    rotations: "rotation",
    log_scales: "scale",
    opacity_logits: "opacity",
    sh: "colour",
    normals: "normal",
    offsets: "offset",
};

/// Makes infinite logits and logarithms finite where they mean something: opaque, transparent, flat.
pub(in crate::scene) fn make_finite(opacity_logit: &mut f32, log_scales: &mut [f32; 3]) {
    if opacity_logit.is_infinite() {
        *opacity_logit = quantise::logit(f64::from(*opacity_logit), quantise::FLOAT_STEP);
    }
    for log_scale in log_scales.iter_mut().filter(|v| **v == f32::NEG_INFINITY) {
        *log_scale = quantise::log_scale(0.0);
    }
}

/// Whether a quaternion has a direction in single precision.
pub(in crate::scene) fn is_rotation(quaternion: [f32; 4]) -> bool {
    quaternion.iter().map(|v| v * v).sum::<f32>() != 0.0
}

/// What was left out so far.
#[derive(Debug, Default)]
pub(in crate::scene) struct Dropped {
    count: usize,
    first: Option<(usize, String, f32)>,
    /// Gaussians whose quaternion is 0.
    unturned: usize,
    first_unturned: Option<usize>,
}

impl Dropped {
    /// Notes that the Gaussian `index` is left out for the value of a field.
    pub(in crate::scene) fn add(&mut self, index: usize, field: &str, value: f32) {
        self.count += 1;
        self.first.get_or_insert_with(|| (index, field.to_owned(), value));
    }

    /// Notes that the Gaussian `index` is left out because its quaternion is 0.
    pub(in crate::scene) fn add_unturned(&mut self, index: usize) {
        self.unturned += 1;
        self.first_unturned.get_or_insert(index);
    }

    /// Warns in the log where some of the file's Gaussians were left out.
    ///
    /// # Errors
    /// [`SceneError::NotFinite`] with the first of them where none is left, [`SceneError::ZeroRotations`] where all of them
    /// have the quaternion 0.
    pub(in crate::scene) fn report(self, kept: usize, path: &Path) -> Result<(), SceneError> {
        let (place, all) = (path.display().to_string(), kept + self.count + self.unturned);
        if let Some((index, field, value)) = self.first {
            if kept == 0 {
                return Err(SceneError::NotFinite { place, field, index, value });
            }
            log::warn!(
                "{place}: {} of {all} Gaussians have values that are not finite and are left out; the first is {index}, \
                 whose `{field}` is {value}",
                self.count
            );
        }
        if let Some(index) = self.first_unturned {
            if kept == 0 {
                return Err(SceneError::ZeroRotations { path: path.to_owned(), count: all });
            }
            log::warn!(
                "{place}: {} of {all} Gaussians have a rotation of four zeros and are left out; the first is {index}",
                self.unturned
            );
        }
        Ok(())
    }
}

/// The Gaussians of the file at `path` whose values are all finite and whose quaternions are not 0.
///
/// # Errors
/// As [`Dropped::report`].
pub(super) fn only(mut gaussians: Gaussians, path: &Path) -> Result<Gaussians, SceneError> {
    let mut dropped = Dropped::default();
    for (logit, scales) in gaussians.opacity_logits.iter_mut().zip(&mut gaussians.log_scales) {
        make_finite(logit, scales);
    }
    let keep: Vec<bool> = (0..gaussians.len()).map(|index| is_usable(&gaussians, index, &mut dropped)).collect();
    if keep.contains(&false) {
        let kept = (0..gaussians.len()).filter(|&index| keep[index]);
        gaussians = gaussians.rows(kept.clone().count(), kept);
    }
    dropped.report(gaussians.len(), path)?;
    Ok(gaussians)
}

fn is_usable(g: &Gaussians, index: usize, dropped: &mut Dropped) -> bool {
    let named = WORDS.zip(g.row(index)).into_array();
    let bad = named.iter().find_map(|(word, values)| Some((word, values.iter().find(|v| !v.is_finite())?)));
    if let Some((word, &value)) = bad {
        dropped.add(index, word, value);
        return false;
    }
    let is_rotation = is_rotation(g.rotations[index]);
    if !is_rotation {
        dropped.add_unturned(index);
    }
    is_rotation
}
