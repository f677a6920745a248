//! A model as one file.

use super::{Model, ModelError};
use crate::bundle::Bundle;
use crate::output::multi_view;
use crate::progress::Progress;
use crate::residual::weights;

impl Model {
    /// Has all Gaussians in memory, in place of levels of detail.
    ///
    /// # Errors
    /// The levels' file cannot be read.
    pub fn expand(&mut self) -> Result<(), ModelError> {
        if let Some(levels) = self.levels.take() {
            self.gaussians = levels.whole()?;
        }
        Ok(())
    }

    /// Everything that rendering the model needs; loads the scene where the model does not bring its photos.
    ///
    /// # Errors
    /// As [`Model::load_photos`], or as [`Model::training_photos`].
    pub fn into_bundle(mut self, progress: &dyn Progress) -> Result<Bundle, ModelError> {
        self.load_photos(progress)?;
        self.expand()?;
        let network = self.network.as_deref().map(weights::to_bytes).transpose()?;
        let photos = self.load_training_photos(progress)?;
        let field = self.exposure_field()?;
        let sources = multi_view::of_cameras(&self.cameras, &self.config.sources);
        let training = self.training_views();
        let names = || training.iter().map(|record| record.name.clone());
        let exposure = field.map(|field| names().zip(field.photos().iter().copied()).collect());
        let photos = names().zip(photos).collect();
        let Model { config, cameras, iteration, gaussians, members, .. } = self;
        Ok(Bundle { iteration, gaussians, members, levels: None, network, exposure, cameras, config, photos, sources })
    }
}
