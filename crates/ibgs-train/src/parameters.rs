//! What a training learns, as burn tensors whose memory the kernels share.

use crate::tensor::{self, bind, from_primitive};
use burn::tensor::Tensor;
use burn_cubecl::tensor::CubeTensor;
use ibgs_core::gpu::{Gpu, GpuError};
use ibgs_core::local_space::LocalSpace;
use ibgs_core::residual::ResidualNetwork;
use ibgs_core::residual::layers::WEIGHTS;
use ibgs_core::residual::variant::Variant;
use ibgs_core::residual::weights::initial;
use ibgs_core::scene::{Gaussians, Harmonics, PerGaussian, Splats};

/// The Gaussians' raw parameters (method.md section 1).
#[derive(Clone, Debug)]
pub struct Parameters {
    /// The tensors, each of one dimension: kernels read their memory alone.
    pub tensors: PerGaussian<CubeTensor>,
    splats: Splats,
}

impl Parameters {
    /// Copies a model to the device.
    ///
    /// # Errors
    /// When the device cannot bind one of its tensors at once.
    pub fn upload(g: &Gaussians, gpu: &Gpu) -> Result<Self, GpuError> {
        let named = PerGaussian::NAMES.zip(g.values());
        let tensors = named.try_map(|(name, values)| tensor::upload(gpu, name, values, &[values.len()]))?;
        Ok(Self::new((g.space, g.len(), g.sh_coefficients()), tensors))
    }

    /// From the tensors of `count` Gaussians with `coefficients` colours each.
    pub fn new((space, count, coefficients): (LocalSpace, usize, usize), tensors: PerGaussian<CubeTensor>) -> Self {
        let parameters = tensors.as_ref().map(bind);
        let harmonics = Harmonics::Full;
        let splats = Splats { space, count, coefficients, harmonics, parameters };
        Self { tensors, splats }
    }

    /// As kernels and renderers read them, in the same memory.
    pub fn splats(&self) -> &Splats {
        &self.splats
    }

    /// Opacities before the sigmoid, `[N]`.
    pub fn opacity_logits(&self) -> Tensor<1> {
        from_primitive(self.tensors.opacity_logits.clone())
    }

    /// Logarithms of the scales, three a Gaussian.
    pub fn log_scales(&self) -> Tensor<1> {
        from_primitive(self.tensors.log_scales.clone())
    }
}

/// The residual network's weights.
#[derive(Clone, Debug)]
pub struct NetworkParameters {
    tensor: CubeTensor,
    network: ResidualNetwork,
}

impl NetworkParameters {
    /// Weights that have learned nothing yet, see [`initial`].
    ///
    /// # Errors
    /// burn refuses the device.
    pub fn init(gpu: &Gpu, variant: &Variant, seed: u64) -> Result<Self, GpuError> {
        Self::upload(gpu, &initial(variant, seed))
    }

    /// These weights.
    ///
    /// # Errors
    /// burn refuses the device.
    ///
    /// # Panics
    /// With another number of weights: a bug of ours.
    pub fn upload(gpu: &Gpu, weights: &[f32]) -> Result<Self, GpuError> {
        assert_eq!(weights.len(), WEIGHTS, "weights of the network");
        let tensor = tensor::upload(gpu, "weights of the network", weights, &[WEIGHTS])?;
        let network = ResidualNetwork { weights: bind(&tensor) };
        Ok(Self { tensor, network })
    }

    /// As kernels and renderers read them, in the same memory.
    pub fn network(&self) -> &ResidualNetwork {
        &self.network
    }

    /// The tensor, `[WEIGHTS]`.
    pub fn tensor(&self) -> Tensor<1> {
        from_primitive(self.tensor.clone())
    }
}
