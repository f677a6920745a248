//! The photos' exposures in a training, see [`ibgs_core::exposure`].

use ibgs_core::camera::Camera;
use ibgs_core::config::{ExposureConfig, ExposureSwitch};
use ibgs_core::exposure::{ExposureAdam, ExposureField, ExposurePass, ExposureState, Exposures, PhotoExposures};
use ibgs_core::gpu::{Gpu, GpuError, Pass};
use std::sync::Arc;

/// The exposures of the training photos as they are learned.
pub(super) struct Exposing {
    gpu: Arc<Gpu>,
    exposure_pass: ExposurePass,
    photos: PhotoExposures,
}

impl Exposing {
    /// None where they are not corrected.
    pub fn new(gpu: &Arc<Gpu>, photos: usize, config: &ExposureConfig) -> Result<Option<Self>, GpuError> {
        let ExposureConfig { beta1, beta2, epsilon: eps, .. } = *config;
        let make = || {
            Ok(Self {
                gpu: gpu.clone(),
                exposure_pass: ExposurePass::new(gpu.clone()),
                photos: PhotoExposures::new(gpu, photos, ExposureAdam { beta1, beta2, eps })?,
            })
        };
        (config.enabled != ExposureSwitch::Off).then(make).transpose()
    }

    /// Those of a view and of its sources, on the device.
    pub fn of(&self, view: usize, sources: &[usize]) -> Result<Exposures, GpuError> {
        self.exposure_pass.gather(&self.photos, view, sources)
    }

    /// Records the step of a view's exposure by the gradient of its iteration.
    pub fn record_step(&mut self, pass: &mut Pass, view: usize, exposures: &Exposures, rate: f64) {
        pass.relabel("exposure");
        self.photos.record_step(pass, view, exposures.v_target(), rate);
    }

    /// What they say of any view; waits for the GPU.
    pub fn field(&self, cameras: &Arc<[Camera]>) -> Result<ExposureField, GpuError> {
        Ok(ExposureField::new(cameras.clone(), self.photos.exposures(&self.gpu)?))
    }

    /// Everything on the host; waits for the GPU.
    pub fn states(&self) -> Result<Vec<ExposureState>, GpuError> {
        self.photos.states(&self.gpu)
    }

    pub fn restore(&mut self, states: &[ExposureState]) -> Result<(), GpuError> {
        self.photos = PhotoExposures::from_states(&self.gpu, states, self.photos.adam)?;
        Ok(())
    }
}
