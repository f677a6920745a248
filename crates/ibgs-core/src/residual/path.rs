//! The hourglass in one of its two precisions.

use super::half::HalfHourglass;
use super::hourglass::Hourglass;
use crate::gpu::{Buffer, Gpu, GpuError, Pass};

/// Memory of one image size, in float32 or in half precision on matrix units.
#[derive(Debug)]
pub(super) enum Path {
    Full(Box<Hourglass>),
    Half(Box<HalfHourglass>),
}

impl Path {
    /// On the matrix units where `half` is wanted and the adapter has some.
    pub fn new(gpu: &Gpu, [width, height]: [u32; 2], gradients: bool, half: bool) -> Result<Self, GpuError> {
        let half = if half { HalfHourglass::new(gpu, width, height, gradients)? } else { None };
        Ok(match half {
            Some(path) => Self::Half(Box::new(path)),
            None => Self::Full(Box::new(Hourglass::new(gpu, width, height, gradients)?)),
        })
    }

    /// The input, `[38][height * width]`, for the caller to write.
    pub fn x(&self) -> &Buffer {
        match self {
            Self::Full(path) => path.x(),
            Self::Half(path) => path.planes(),
        }
    }

    /// The gradient by the input after [`Path::backward`].
    pub fn v_x(&self) -> &Buffer {
        match self {
            Self::Full(path) => path.v_x(),
            Self::Half(path) => path.planes(),
        }
    }

    /// The output of [`Path::forward`], `[height * width * 3]`.
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
    pub fn backward(&self, pass: &mut Pass, weights: &Buffer, v_residual: &Buffer, v_weights: &Buffer) {
        match self {
            Self::Full(path) => path.backward(pass, weights, v_residual, v_weights),
            Self::Half(path) => path.backward(pass, weights, v_residual, v_weights),
        }
    }
}
