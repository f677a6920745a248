//! A model as one file.

use super::{Model, ModelError};
use crate::bundle::Bundle;
use crate::gpu::GpuError;
use crate::output::multi_view;
use crate::progress::Progress;
use crate::residual::weights;
use crate::scene::Gaussians;

impl Model {
    /// All its Gaussians, also of a model with levels of detail.
    ///
    /// # Errors
    /// Its file cannot be read.
    pub fn whole(&mut self) -> Result<Gaussians, ModelError> {
        match &self.levels {
            Some(levels) => {
                levels.gaussians(levels.leaves()).map_err(|error| GpuError::Levels(error.to_string()).into())
            }
            None => Ok(std::mem::take(&mut self.gaussians)),
        }
    }

    /// Everything that rendering the model needs; loads the scene where the model does not bring its photos.
    ///
    /// # Errors
    /// As [`Model::load_photos`], or as [`Model::training_photos`].
    pub fn into_bundle(mut self, progress: &dyn Progress) -> Result<Bundle, ModelError> {
        self.load_photos(progress)?;
        self.gaussians = self.whole()?;
        if self.photos.is_none() {
            self.dataset(progress)?;
        }
        let network = self.network.as_deref().map(weights::to_bytes).transpose()?;
        let photos = self.training_photos()?;
        let field = self.exposure_field()?;
        let sources = multi_view::of_cameras(&self.cameras, &self.config.sources);
        let training = self.training_views();
        let names = || training.iter().map(|record| record.name.clone());
        let exposure = field.map(|field| names().zip(field.photos().iter().copied()).collect());
        let photos = names().zip(photos).collect();
        let Model { config, cameras, iteration, gaussians, .. } = self;
        Ok(Bundle { iteration, gaussians, levels: None, network, exposure, cameras, config, photos, sources })
    }
}
