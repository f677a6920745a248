//! The residual network's weights on the device.

use super::layers::WEIGHTS;
use super::weights::NetworkError;
use crate::gpu::{Buffer, Gpu};

/// All weights of the per-view MLP and the U-Net (method.md section 6). Clones share the memory.
#[derive(Clone, Debug)]
pub struct ResidualNetwork {
    /// Flat weights in the layout of [`layers`](super::layers), `[WEIGHTS]`.
    pub weights: Buffer<f32>,
}

impl ResidualNetwork {
    /// A network with the given flat weights.
    ///
    /// # Errors
    /// Another number of weights, not enough memory.
    pub fn from_values(gpu: &Gpu, weights: &[f32]) -> Result<Self, NetworkError> {
        if weights.len() != WEIGHTS {
            return Err(NetworkError::Count { found: weights.len() });
        }
        Ok(Self { weights: gpu.upload("weights of the network", weights)? })
    }

    /// Copies the flat weights back; waits for the device.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn to_values(&self, gpu: &Gpu) -> Result<Vec<f32>, NetworkError> {
        Ok(gpu.read(&self.weights, WEIGHTS)?)
    }
}
