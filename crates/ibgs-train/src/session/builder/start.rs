//! What a training begins with in place of the scene's points.

use ibgs_core::dataset::Dataset;
use ibgs_core::ensemble::united;
use ibgs_core::exposure::Exposure;
use ibgs_core::model::{Model, ModelError, ModelOptions, is_bundle};
use ibgs_core::scene::{Gaussians, read_gaussians};
use std::collections::HashMap;
use std::path::Path;

/// A file of Gaussians, or a model.
#[derive(Debug)]
pub struct Start {
    /// Its Gaussians; those of an ensemble as one.
    pub gaussians: Gaussians,
    /// Of a model whose exposures were corrected: those of its photos by name.
    exposures: Option<HashMap<String, Exposure>>,
}

impl Start {
    /// Reads a file of Gaussians, a bundle or a model folder.
    pub fn read(path: &Path) -> Result<Self, ModelError> {
        if !path.is_dir() && !is_bundle(path) {
            return Ok(Self { gaussians: read_gaussians(path)?, exposures: None });
        }
        let mut model = Model::open(path, &ModelOptions::default())?;
        model.expand()?;
        let gaussians = if model.members.is_empty() {
            std::mem::take(&mut model.gaussians)
        } else {
            united(&model.gaussians, &model.members)
        };
        Ok(Self { gaussians, exposures: model.exposures().cloned() })
    }

    /// Whether exposures were corrected.
    pub fn has_exposures(&self) -> bool {
        self.exposures.is_some()
    }

    /// The exposures of the training photos, in their order; a photo that the model does not know has none. None where they were
    /// not corrected.
    pub fn exposures(&self, dataset: &Dataset) -> Option<Vec<Exposure>> {
        let known = self.exposures.as_ref()?;
        let own = |&view: &usize| known.get(&dataset.views[view].name).copied().unwrap_or_default();
        Some(dataset.train.iter().map(own).collect())
    }
}
