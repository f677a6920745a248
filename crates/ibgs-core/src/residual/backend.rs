//! The U-Net in one of its two precisions.

use super::features::{FeatureInputs, Features};
use super::half::HalfUNet;
use super::unet::UNet;
use crate::gpu::{Buffer, Gpu, GpuError, Pass};
use crate::raster::Keep;

/// What the U-Net computes with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arithmetic {
    /// Float32, on any adapter.
    Full,
    /// Half precision on matrix units, summed in float32; float32 where the adapter has none.
    Half,
}

/// Memory of one image size, in float32 or in half precision on matrix units.
#[derive(Debug)]
pub enum Backend {
    /// Float32.
    Full(Box<UNet>),
    /// Half precision on matrix units.
    Half(Box<HalfUNet>),
}

impl Backend {
    /// For images of a size; with memory for gradients where they are kept.
    ///
    /// # Errors
    /// Not enough memory, or more than the device binds at once.
    pub fn new(gpu: &Gpu, [width, height]: [u32; 2], keep: Keep, arithmetic: Arithmetic) -> Result<Self, GpuError> {
        let half = match arithmetic {
            Arithmetic::Half => HalfUNet::new(gpu, width, height, keep)?,
            Arithmetic::Full => None,
        };
        Ok(match half {
            Some(path) => Self::Half(Box::new(path)),
            None => Self::Full(Box::new(UNet::new(gpu, width, height, keep)?)),
        })
    }

    /// Records the input.
    pub fn record_input(&self, pass: &mut Pass, features: &Features, inputs: &FeatureInputs) {
        match self {
            Self::Full(path) => features.record(pass, inputs, path.x()),
            Self::Half(path) => features.record_half(pass, inputs, path.x()),
        }
    }

    /// Writes the input from planes, `[38][height * width]`.
    pub fn write_input(&self, gpu: &Gpu, planes: &[f32]) {
        match self {
            Self::Full(path) => gpu.queue.write_buffer(&path.x().buffer, path.x().offset, bytemuck::cast_slice(planes)),
            Self::Half(path) => path.write_input(gpu, planes),
        }
    }

    /// The gradient by the input after [`Backend::backward`], `[38][height * width]`.
    pub fn v_x(&self) -> &Buffer {
        match self {
            Self::Full(path) => path.v_x(),
            Self::Half(path) => path.v_x(),
        }
    }

    /// The output of [`Backend::forward`], `[height * width * 3]`.
    pub fn residual(&self) -> &Buffer {
        match self {
            Self::Full(path) => path.residual(),
            Self::Half(path) => path.residual(),
        }
    }

    /// From x to the residual.
    pub fn forward(&self, pass: &mut Pass, weights: &Buffer) {
        match self {
            Self::Full(path) => path.forward(pass, weights),
            Self::Half(path) => path.forward(pass, weights),
        }
    }

    /// From the gradient by the residual to those by x and by the weights.
    ///
    /// # Panics
    /// When made without gradients: a bug of ours.
    pub fn backward(&self, pass: &mut Pass, weights: &Buffer, v_residual: &Buffer, v_weights: &Buffer) {
        match self {
            Self::Full(path) => path.backward(pass, weights, v_residual, v_weights),
            Self::Half(path) => path.backward(pass, weights, v_residual, v_weights),
        }
    }
}
