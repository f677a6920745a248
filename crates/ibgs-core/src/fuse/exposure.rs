//! Exposure correction of the residual stage (method.md section 8): the affine colour map that takes the base colours
//! of a target view to the exposure of its first source.

use crate::gpu::{Buffer, Gpu, GpuError, Pass};
use ibgs_shaders::{EXPOSURE_APPLY, EXPOSURE_APPLY_BACKWARD, EXPOSURE_GROUPS, EXPOSURE_SOLVE, EXPOSURE_SUMS};

/// The least-squares fit, its scratch memory and its result.
///
/// Fitted over the pixels whose first slot holds source 0. The map is the identity with fewer than 64 of them or when
/// the system is ill-conditioned: smallest pivot of the base colours' covariance under 1e-5 of the largest (colours in
/// a plane, a grey picture) or all of it under a variance of 1e-8 (a flat picture). A ridge of 1e-6 of the mean
/// variance pulls towards the identity.
#[derive(Debug)]
pub struct ExposureFit {
    partials: Buffer,
    /// `[3, 4]` f32: rows of [A | t], so that corrected = A base + t. All zero before the first fit.
    pub map: Buffer,
}

/// Number of pixels as immediate data, and as a number of threads.
fn pixels(size: [u32; 2]) -> ([u8; 4], usize) {
    let pixels = size[0] * size[1];
    (pixels.to_ne_bytes(), pixels as usize)
}

impl ExposureFit {
    /// Scratch memory, which is the same for every image size.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let partials = gpu.allocate("exposure sums", 7 * 16 * u64::from(EXPOSURE_GROUPS))?;
        Ok(Self { partials, map: gpu.allocate("exposure map", 48)? })
    }

    /// Records the fit of [`Self::map`]: `base` `[P, 3]` f32, `warped` `[V, P, 4]` f32 of which slot 0 is read, `seen`
    /// `[P]` u32 with the number of slot 0's source in its lowest byte; `size` is (width, height), P = width x height.
    pub fn record_fit(&self, pass: &mut Pass, base: &Buffer, warped: &Buffer, seen: &Buffer, size: [u32; 2]) {
        let (count, _) = pixels(size);
        pass.groups(&EXPOSURE_SUMS, &[base, warped, seen, &self.partials], &count, EXPOSURE_GROUPS as usize);
        pass.groups(&EXPOSURE_SOLVE, &[&self.partials, &self.map], &[], 1);
    }

    /// Records `corrected = A base + t`, both `[P, 3]` f32.
    pub fn record_apply(&self, pass: &mut Pass, base: &Buffer, corrected: &Buffer, size: [u32; 2]) {
        let (count, threads) = pixels(size);
        pass.linear(&EXPOSURE_APPLY, &[&self.map, base, corrected], &count, threads);
    }

    /// Records `v_base += A^T v_corrected`, both `[P, 3]` f32. Nothing flows through the fit.
    pub fn record_apply_backward(&self, pass: &mut Pass, v_corrected: &Buffer, v_base: &Buffer, size: [u32; 2]) {
        let (count, threads) = pixels(size);
        pass.linear(&EXPOSURE_APPLY_BACKWARD, &[&self.map, v_corrected, v_base], &count, threads);
    }
}
