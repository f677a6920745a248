//! The 3D smoothing filter of the training views: no Gaussian is narrower than the nearest of them can resolve, so that
//! renders from other distances do not show detail that no photo has. Yu et al., "Mip-Splatting", CVPR 2024.

use ibgs_core::camera::Camera;
use ibgs_core::gpu::{Buffer, Gpu, GpuError, Pass};
use ibgs_core::scene::Splats;
use ibgs_shaders::bindings::FilterSizesBindings;
use ibgs_shaders::types::FilterParams;

/// Finds the sizes of the filters.
#[derive(Debug)]
pub struct FilterSizes {
    /// Centre and larger focal length in pixels of each camera, by rows.
    cameras: Buffer<[f32; 4]>,
    count: u32,
    factor: f32,
}

impl FilterSizes {
    /// Filters of `factor` pixels of the nearest camera.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn new(gpu: &Gpu, cameras: &[Camera], factor: f64) -> Result<Self, GpuError> {
        let rows: Vec<[f32; 4]> =
            cameras.iter().map(|c| c.center().extend(c.focal.max_element()).as_vec4().to_array()).collect();
        let cameras = gpu.upload("cameras of the filters", &rows)?;
        Ok(Self { cameras, count: rows.len() as u32, factor: factor as f32 })
    }

    /// Sets the filter of every Gaussian by where it is now, in place.
    pub fn update(&self, gpu: &Gpu, splats: &Splats) {
        let params = FilterParams { count: splats.len() as u32, cameras: self.count, factor: self.factor };
        let mut pass = Pass::new(gpu, "filter sizes");
        let means = &splats.parameters.means;
        let buffers = FilterSizesBindings { means, cameras: &self.cameras, filters: &splats.filters };
        pass.linear(&buffers, &params, splats.len());
        pass.submit();
    }
}
