//! The residual network on the device, as a burn module.

use super::layers::WEIGHTS;
use super::weights::NetworkError;
use super::weights::{initial, read, write};
use crate::gpu::Gpu;
use burn::module::{Module, Param, ParamId};
use burn::tensor::{Tensor, TensorData};
use std::path::Path;

/// All weights of the per-view MLP and the hourglass (method.md section 6).
#[derive(Module, Debug)]
pub struct ResidualNetwork {
    /// Flat weights in the layout of [`layers`](super::layers), `[WEIGHTS]`.
    pub weights: Param<Tensor<1>>,
}

impl ResidualNetwork {
    /// A network with random weights: uniform in +-1/sqrt(fan in), weights and biases. The same seed gives the same ones
    /// on every machine.
    pub fn init(gpu: &Gpu, seed: u64) -> Self {
        Self::upload(gpu, initial(seed))
    }

    /// A network with the given flat weights.
    ///
    /// # Errors
    /// Another number of weights.
    pub fn from_values(gpu: &Gpu, weights: &[f32]) -> Result<Self, NetworkError> {
        if weights.len() != WEIGHTS {
            return Err(NetworkError::Count { found: weights.len() });
        }
        Ok(Self::upload(gpu, weights.to_vec()))
    }

    fn upload(gpu: &Gpu, weights: Vec<f32>) -> Self {
        let tensor = Tensor::from_data(TensorData::new(weights, [WEIGHTS]), &gpu.burn);
        Self { weights: Param::initialized(ParamId::new(), tensor) }
    }

    /// Copies the flat weights back; waits for the device.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn to_values(&self) -> Result<Vec<f32>, NetworkError> {
        let data = self.weights.val().try_into_data().map_err(|e| NetworkError::Device(format!("{e:?}")))?;
        data.try_into_vec().map_err(|e| NetworkError::Device(format!("{e:?}")))
    }

    /// Reads a network from a safetensors file ([`FILE_NAME`](super::weights::FILE_NAME)) with the tensor names of the published state dict.
    ///
    /// # Errors
    /// A file that cannot be read or is damaged, a tensor that is missing or has another shape or type, values not finite.
    pub fn load(gpu: &Gpu, path: &Path) -> Result<Self, NetworkError> {
        Ok(Self::upload(gpu, read(path)?))
    }

    /// Writes the network as a safetensors file in one step.
    ///
    /// # Errors
    /// Values not finite, a file that cannot be written, or a lost device.
    pub fn save(&self, path: &Path) -> Result<(), NetworkError> {
        write(path, &self.to_values()?)
    }
}
