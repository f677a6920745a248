//! Exposure correction of the residual stage (method.md section 8), for the output and for every source by itself: affine
//! colour maps that take the base colours of a target view to the exposure of other pictures.

use super::warp::{MAX_SOURCES, Reach};
use crate::gpu::{Buffer, Gpu, GpuError, Pass};
use bytemuck::bytes_of;
use ibgs_shaders::types::{ExposureApplyParams, ExposureSumsParams};
use ibgs_shaders::{EXPOSURE_APPLY, EXPOSURE_APPLY_BACKWARD, EXPOSURE_GROUPS, EXPOSURE_SOLVE, EXPOSURE_SUMS};

/// Stands for the target's photo in place of a source's number.
const PHOTO: u32 = 255;

/// The least-squares fits, their scratch memory and their results.
///
/// The first map takes base colours to the exposure of the output: that of the target's photo where there is one, in training,
/// and of the first source elsewhere. The others take them to the exposure of each source, over the pixels that see it. With
/// fewer than 64 of them, or when the system is ill-conditioned, the first map is the identity and the others are as the first:
/// smallest pivot of the base colours' covariance under 1e-5 of the largest (colours in a plane, a grey picture) or all of it
/// under a variance of 1e-8 (a flat picture). A ridge of 1e-6 of the mean variance pulls towards the identity.
#[derive(Debug)]
pub struct ExposureFit {
    partials: Buffer,
    /// `[1 + M, 3, 4]` f32: rows of [A | t], so that corrected = A base + t. All zero before the first fit.
    pub maps: Buffer,
}

/// What is fitted, and what the maps are applied to. P pixels, V slots.
#[derive(Clone, Copy, Debug)]
pub struct ExposedColors<'a> {
    /// `[P, 3]` f32.
    pub base: &'a Buffer,
    /// `[V, P, 4]` f32: colour and cosine.
    pub warped: &'a Buffer,
    /// Which sources the pixels see, `[P]` u32 as in [`Seen::slots`](super::Seen::slots).
    pub seen: &'a Buffer,
    /// V.
    pub slots: u32,
    /// M.
    pub sources: u32,
    /// Which base colours are corrected.
    pub reach: Reach,
    /// Width and height.
    pub size: [u32; 2],
}

impl ExposedColors<'_> {
    fn params(&self) -> ExposureApplyParams {
        let seen_only = u32::from(self.reach == Reach::Seen);
        ExposureApplyParams { pixels: self.size[0] * self.size[1], slots: self.slots, seen_only }
    }
}

impl ExposureFit {
    /// Scratch memory, which is the same for every image size.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let partials = gpu.allocate("exposure sums", 7 * 16 * u64::from(EXPOSURE_GROUPS))?;
        Ok(Self { partials, maps: gpu.allocate("exposure maps", 48 * (1 + MAX_SOURCES as u64))? })
    }

    /// Records the fits of [`Self::maps`]; `photo`: packed RGBA8 of the target, masked where alpha is under one half.
    pub fn record_fit(&self, pass: &mut Pass, colors: &ExposedColors, photo: Option<&Buffer>) {
        let ExposedColors { base, warped, seen, sources, .. } = *colors;
        let ExposureApplyParams { pixels, slots, .. } = colors.params();
        let output = if photo.is_some() { PHOTO } else { 0 };
        let photo = photo.unwrap_or(seen);
        for (index, other) in (0u32..).zip(std::iter::once(output).chain(0..sources)) {
            let params = ExposureSumsParams { pixels, slots, other };
            let buffers = [base, warped, seen, photo, &self.partials];
            pass.groups(&EXPOSURE_SUMS, &buffers, bytes_of(&params), EXPOSURE_GROUPS as usize);
            pass.groups(&EXPOSURE_SOLVE, &[&self.partials, &self.maps], bytes_of(&index), 1);
        }
    }

    /// Records the base colours in the output's exposure `corrected = A_0 base + t_0`, `[P, 3]`, and the warped colours with the
    /// change of exposure from their source to the output, `shifted`, `[V, P, 4]`: less `corrected` they differ as the warped
    /// colours do from the base in their source's exposure.
    pub fn record_apply(&self, pass: &mut Pass, colors: &ExposedColors, corrected: &Buffer, shifted: &Buffer) {
        let params = colors.params();
        let buffers = [&self.maps, colors.base, colors.warped, colors.seen, corrected, shifted];
        pass.linear(&EXPOSURE_APPLY, &buffers, bytes_of(&params), params.pixels as usize);
    }

    /// Records what both add to `v_base`, `[P, 3]`. That by the warped colours is `v_shifted` itself; nothing flows through the
    /// fits.
    pub fn record_apply_backward(
        &self,
        pass: &mut Pass,
        colors: &ExposedColors,
        [v_corrected, v_shifted]: [&Buffer; 2],
        v_base: &Buffer,
    ) {
        let params = colors.params();
        let buffers = [&self.maps, colors.seen, v_corrected, v_shifted, v_base];
        pass.linear(&EXPOSURE_APPLY_BACKWARD, &buffers, bytes_of(&params), params.pixels as usize);
    }
}
