//! The Gaussians on the device.

use super::{Gaussians, Harmonics, PerGaussian, SceneError};
use crate::gpu::{Buffer, Gpu, GpuError};
use crate::local_space::LocalSpace;
use bytemuck::cast_slice;
use std::borrow::Cow;

/// Points are far smaller than a pixel, which then is their size, and opaque.
const POINT_LOG_SCALE: f32 = -16.0;
const POINT_LOGIT: f32 = 16.0;

/// Raw parameters, before activation (method.md section 1), in local coordinates. Clones share the memory.
#[derive(Clone, Debug)]
pub struct Splats {
    /// Where the local coordinates lie in the scene.
    pub space: LocalSpace,
    /// Number of Gaussians, N.
    pub count: usize,
    /// Colours of spherical harmonics each, `(degree + 1)^2`.
    pub coefficients: usize,
    /// How precisely those are kept.
    pub harmonics: Harmonics,
    /// Their numbers, float32 but for that.
    pub parameters: PerGaussian<Buffer<f32>>,
}

impl Splats {
    /// Copies a model to the device.
    ///
    /// # Errors
    /// When the device cannot bind one of its buffers at once, cannot have one of the spherical harmonics, which are bound in parts,
    /// or has no memory left.
    pub fn upload(g: &Gaussians, gpu: &Gpu) -> Result<Self, GpuError> {
        Self::upload_in(g, gpu, Harmonics::Full)
    }

    /// The same with the spherical harmonics in a precision.
    ///
    /// # Errors
    /// As [`Splats::upload`].
    pub fn upload_in(g: &Gaussians, gpu: &Gpu, harmonics: Harmonics) -> Result<Self, GpuError> {
        let coefficients = g.sh_coefficients();
        let packed = harmonics.pack(g.values(), coefficients);
        let upload = |(name, words): (_, &Cow<'_, [u32]>)| {
            if name == PerGaussian::NAMES.sh { gpu.upload_for_parts(name, words) } else { gpu.upload(name, words) }
        };
        Ok(Self {
            space: g.space,
            count: g.len(),
            coefficients,
            harmonics,
            parameters: PerGaussian::NAMES.zip(packed.as_ref()).try_map(upload)?.map(|words| words.cast()),
        })
    }

    /// Gaussians whose spherical harmonics the device binds at once, at most; all of their parts begin where a binding may.
    pub(crate) fn at_once(&self, gpu: &Gpu) -> usize {
        const STEP: usize = 64;
        let row = 4 * self.harmonics.rows(self.coefficients).sh;
        (gpu.binding_limit() as usize / row / STEP * STEP).max(STEP)
    }

    /// The same Gaussians as opaque points: nothing of them is left but centre and colour. All else shares its memory.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn as_points(&self, gpu: &Gpu) -> Result<Self, GpuError> {
        let parameters = PerGaussian {
            log_scales: gpu.upload("log scales", &vec![POINT_LOG_SCALE; 3 * self.count])?,
            opacity_logits: gpu.upload("opacity logits", &vec![POINT_LOGIT; self.count])?,
            ..self.parameters.clone()
        };
        Ok(Self { parameters, ..self.clone() })
    }

    /// Copies the model back; waits for the device.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn download(&self, gpu: &Gpu) -> Result<Gaussians, SceneError> {
        let device_error = |e: GpuError| SceneError::Device(e.to_string());
        let rows = self.harmonics.rows(self.coefficients);
        let read = |(buffer, row): (&Buffer<f32>, usize)| gpu.read(buffer, row * self.count);
        let values = self.parameters.as_ref().zip(rows).try_map(read).map_err(device_error)?;
        let sh = self.harmonics.unpack_sh(cast_slice(&values.sh), self.coefficients);
        Ok(Gaussians::from_values(self.space, self.sh_degree(), PerGaussian { sh, ..values }))
    }

    /// The raw quaternions, one a row.
    pub fn rotations(&self) -> Buffer<[f32; 4]> {
        self.parameters.rotations.cast()
    }

    /// The spherical harmonics as words of two halves, which they are with [`Harmonics::Half`].
    pub(crate) fn half_sh(&self) -> Buffer<u32> {
        self.parameters.sh.cast()
    }

    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.count
    }

    /// True without any Gaussian.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Stored spherical-harmonics degree.
    pub fn sh_degree(&self) -> u32 {
        (self.coefficients as f64).sqrt() as u32 - 1
    }
}
