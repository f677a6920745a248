//! A new run where a model may be already: it is kept, or removed as a whole.

use super::cameras::Split;
use super::results::Scored;
use super::{OutputError, OutputFolder, REPORT_FILE, figures};
use crate::config::TrainConfig;
use crate::eval::fitted::FITTED_POSES_FILE;
use crate::eval::true_cameras::TRUE_CAMERAS_FILE;
use crate::files::{self, WriteError};
use std::fs;
use std::io;
use std::path::Path;

/// Files that describe the run, by which our folders are recognised.
const RUN_FILES: [&str; 4] = ["config.toml", "cameras.json", "split.json", "input.ply"];

/// What to do with a model that is in the folder already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// Refuse to touch it.
    Keep,
    /// Remove its point clouds, pictures and results before the new run.
    Replace,
}

impl OutputFolder {
    /// Makes the folder for a new run. Call it once the data set is loaded: with [`Existing::Replace`] an older model
    /// is gone afterwards.
    ///
    /// # Errors
    /// With [`Existing::Keep`], [`OutputError::HoldsModel`] where a trained model is and [`OutputError::Foreign`]
    /// where a file of the run would replace one that belongs to something else. [`OutputError::Write`] in both cases.
    pub fn create(path: &Path, existing: Existing) -> Result<Self, OutputError> {
        files::create_folder(path)?;
        let folder = Self { root: path.to_owned() };
        match existing {
            Existing::Keep => folder.refuse_existing()?,
            Existing::Replace => folder.remove_model()?,
        }
        Ok(folder)
    }

    fn refuse_existing(&self) -> Result<(), OutputError> {
        if let Some(iteration) = self.latest_iteration()? {
            return Err(OutputError::HoldsModel { path: self.root.clone(), iteration });
        }
        if let Some(&(iteration, _)) = self.checkpoints()?.first() {
            return Err(OutputError::HoldsTraining { path: self.root.clone(), iteration });
        }
        // A run that ended before its first save left options that load; its files may be replaced.
        if TrainConfig::load(&self.config_path()).is_ok() {
            return Ok(());
        }
        match RUN_FILES.into_iter().find(|file| self.root.join(file).exists()) {
            None => Ok(()),
            Some(file) => Err(OutputError::Foreign { path: self.root.clone(), file }),
        }
    }

    /// Removes what an older run saved, so that none of it is taken for the new run's.
    fn remove_model(&self) -> Result<(), OutputError> {
        let folders = [
            ("point_cloud", "iteration_"),
            (Split::Test.folder(), "ours_"),
            (Split::Train.folder(), "ours_"),
            ("path", "ours_"),
            ("mesh", "ours_"),
        ];
        for (folder, prefix) in folders {
            for (_, path) in self.numbered(folder, prefix, "")? {
                fs::remove_dir_all(&path).map_err(|source| WriteError::new(&path, source))?;
            }
        }
        self.remove_checkpoints(&[])?;
        let scores = [Scored::Base, Scored::Final].map(Scored::files);
        let others = [
            figures::SPEED_FILE,
            figures::TIME_FILE,
            figures::LOG_FILE,
            REPORT_FILE,
            figures::MESH_FILE,
            "multi_view.json",
            TRUE_CAMERAS_FILE,
            FITTED_POSES_FILE,
        ];
        for file in scores.as_flattened().iter().chain(&others) {
            let path = self.root.join(file);
            match fs::remove_file(&path) {
                Err(error) if error.kind() != io::ErrorKind::NotFound => {
                    return Err(WriteError::new(&path, error).into());
                }
                _ => {}
            }
        }
        Ok(())
    }
}
