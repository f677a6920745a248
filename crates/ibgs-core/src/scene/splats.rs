//! The Gaussians on the device, as a burn module.

use super::{Gaussians, SceneError};
use crate::gpu::{Gpu, GpuError};
use crate::local_space::LocalSpace;
use burn::module::{Module, Param, ParamId};
use burn::tensor::{Device, Tensor, TensorData};

/// Raw parameters, before activation (method.md section 1), in local coordinates.
#[derive(Module, Debug)]
pub struct Splats {
    /// Where the local coordinates lie in the scene.
    #[module(skip)]
    pub space: LocalSpace,
    /// Positions, `[N, 3]`.
    pub means: Param<Tensor<2>>,
    /// Quaternions w x y z, not normalised, `[N, 4]`.
    pub rotations: Param<Tensor<2>>,
    /// Logarithms of the standard deviations, `[N, 3]`.
    pub log_scales: Param<Tensor<2>>,
    /// Opacities before the sigmoid, `[N]`.
    pub opacity_logits: Param<Tensor<1>>,
    /// Spherical-harmonics coefficients, `[N, (degree + 1)^2, 3]`.
    pub sh: Param<Tensor<3>>,
    /// Plane normals, `[N, 3]`.
    pub normals: Param<Tensor<2>>,
    /// Plane offsets, `[N]`.
    pub offsets: Param<Tensor<1>>,
    /// Standard deviations of the 3D smoothing filters, `[N]`, not trained; 0: none.
    pub filters: Param<Tensor<1>>,
}

fn upload<const D: usize>(values: Vec<f32>, shape: [usize; D], device: &Device) -> Param<Tensor<D>> {
    Param::initialized(ParamId::new(), Tensor::from_data(TensorData::new(values, shape), device))
}

fn download<const D: usize>(what: &str, tensor: &Param<Tensor<D>>) -> Result<Vec<f32>, SceneError> {
    let data = tensor.val().try_into_data().map_err(|e| SceneError::Device(format!("{what}: {e:?}")))?;
    data.try_into_vec().map_err(|e| SceneError::Device(format!("{what}: {e:?}")))
}

fn rows<const C: usize>(values: &[f32]) -> Vec<[f32; C]> {
    bytemuck::cast_slice(values).to_vec()
}

impl Splats {
    /// Copies a model to the device.
    ///
    /// # Errors
    /// When the device cannot bind one of its tensors at once.
    pub fn upload(g: &Gaussians, gpu: &Gpu) -> Result<Self, GpuError> {
        let n = g.len();
        let coefficients = g.sh_coefficients();
        gpu.check_size("spherical harmonics", 12 * (n * coefficients) as u64)?;
        gpu.check_size("Gaussians", 48 * n as u64)?;
        let device = &gpu.burn;
        Ok(Self {
            space: g.space,
            means: upload(g.means.as_flattened().to_vec(), [n, 3], device),
            rotations: upload(g.rotations.as_flattened().to_vec(), [n, 4], device),
            log_scales: upload(g.log_scales.as_flattened().to_vec(), [n, 3], device),
            opacity_logits: upload(g.opacity_logits.clone(), [n], device),
            sh: upload(g.sh.clone(), [n, coefficients, 3], device),
            normals: upload(g.normals.as_flattened().to_vec(), [n, 3], device),
            offsets: upload(g.offsets.clone(), [n], device),
            filters: upload(vec![0.0; n], [n], device),
        })
    }

    /// Copies the model back as it renders, the filters a part of scales and opacities; waits for the device.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn download(&self) -> Result<Gaussians, SceneError> {
        let (mut gaussians, filters) = self.download_raw()?;
        gaussians.apply_filters(&filters);
        Ok(gaussians)
    }

    /// Copies the parameters back, and the sizes of the filters; waits for the device.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn download_raw(&self) -> Result<(Gaussians, Vec<f32>), SceneError> {
        let gaussians = Gaussians {
            space: self.space,
            means: rows(&download("means", &self.means)?),
            rotations: rows(&download("rotations", &self.rotations)?),
            log_scales: rows(&download("scales", &self.log_scales)?),
            opacity_logits: download("opacities", &self.opacity_logits)?,
            sh: download("spherical harmonics", &self.sh)?,
            sh_degree: self.sh_degree(),
            normals: rows(&download("normals", &self.normals)?),
            offsets: download("offsets", &self.offsets)?,
        };
        Ok((gaussians, download("filters", &self.filters)?))
    }

    /// Puts other sizes of the filters in place.
    pub fn set_filters(&mut self, filters: Vec<f32>) {
        let n = self.len();
        let tensor = Tensor::from_data(TensorData::new(filters, [n]), &self.means.val().device());
        self.filters = Param::initialized(self.filters.id, tensor);
    }

    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.opacity_logits.val().dims()[0]
    }

    /// True without any Gaussian.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Stored spherical-harmonics degree.
    pub fn sh_degree(&self) -> u32 {
        (self.sh.val().dims()[1] as f64).sqrt() as u32 - 1
    }
}
