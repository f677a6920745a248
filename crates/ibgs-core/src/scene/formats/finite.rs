//! Gaussians with NaN or infinity are left out of what a file holds.

use super::super::{Gaussians, SceneError};
use std::path::Path;

/// What was left out so far.
#[derive(Debug, Default)]
pub(in crate::scene) struct Dropped {
    count: usize,
    first: Option<(usize, String, f32)>,
}

impl Dropped {
    /// Notes that the Gaussian `index` is left out for the value of a field.
    pub(in crate::scene) fn add(&mut self, index: usize, field: &str, value: f32) {
        self.count += 1;
        self.first.get_or_insert_with(|| (index, field.to_owned(), value));
    }

    /// Warns in the log where some of the file's Gaussians were left out.
    ///
    /// # Errors
    /// [`SceneError::NotFinite`] with the first of them where none is left.
    pub(in crate::scene) fn report(self, kept: usize, path: &Path) -> Result<(), SceneError> {
        let Some((index, field, value)) = self.first else { return Ok(()) };
        let (place, count) = (path.display().to_string(), self.count);
        if kept == 0 {
            return Err(SceneError::NotFinite { place, field, index, value });
        }
        log::warn!(
            "{place}: {count} of {} Gaussians have values that are not finite and are left out; the first is {index}, whose \
             `{field}` is {value}",
            kept + count
        );
        Ok(())
    }
}

/// The Gaussians of the file at `path` whose values are all finite.
///
/// # Errors
/// [`SceneError::NotFinite`] where there are others only.
pub(super) fn only(mut gaussians: Gaussians, path: &Path) -> Result<Gaussians, SceneError> {
    let mut dropped = Dropped::default();
    let keep: Vec<bool> = (0..gaussians.len()).map(|index| is_finite(&gaussians, index, &mut dropped)).collect();
    if keep.contains(&false) {
        let row = 3 * gaussians.sh_coefficients();
        retain(&mut gaussians.means, 1, &keep);
        retain(&mut gaussians.rotations, 1, &keep);
        retain(&mut gaussians.log_scales, 1, &keep);
        retain(&mut gaussians.opacity_logits, 1, &keep);
        retain(&mut gaussians.sh, row, &keep);
        retain(&mut gaussians.normals, 1, &keep);
        retain(&mut gaussians.offsets, 1, &keep);
    }
    dropped.report(gaussians.len(), path)?;
    Ok(gaussians)
}

fn is_finite(g: &Gaussians, index: usize, dropped: &mut Dropped) -> bool {
    let row = 3 * g.sh_coefficients();
    let opacity = [g.opacity_logits[index]];
    let fields: [(&str, &[f32]); 5] = [
        ("position", &g.means[index]),
        ("rotation", &g.rotations[index]),
        ("scale", &g.log_scales[index]),
        ("opacity", &opacity),
        ("colour", &g.sh[row * index..row * (index + 1)]),
    ];
    let bad = fields.iter().find_map(|(field, values)| Some((field, values.iter().find(|v| !v.is_finite())?)));
    if let Some((field, &value)) = bad {
        dropped.add(index, field, value);
    }
    bad.is_none()
}

/// Keeps the rows of `row` values each that `keep` marks.
fn retain<T>(values: &mut Vec<T>, row: usize, keep: &[bool]) {
    let mut at = 0;
    values.retain(|_| {
        at += 1;
        keep[(at - 1) / row]
    });
}
