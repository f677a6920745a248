//! Where a session writes.

use super::builder::BuildError;
use ibgs_core::config::TrainConfig;
use ibgs_core::dataset::Dataset;
use ibgs_core::files;
use ibgs_core::output::{Existing, FolderLock, OutputFolder};
use std::fs;
use std::path::{Path, PathBuf};

#[derive(Clone, Debug)]
enum Place {
    At(PathBuf),
    FirstFree(PathBuf),
}

/// The folder that a new training writes to.
#[derive(Clone, Debug)]
pub struct Output {
    place: Place,
    existing: Existing,
}

impl Output {
    /// This folder, which must not hold a model.
    pub fn at(path: impl Into<PathBuf>) -> Self {
        Self { place: Place::At(path.into()), existing: Existing::Keep }
    }

    /// The first of NAME, NAME-2, NAME-3 and so on that is not there.
    pub fn first_free(path: impl Into<PathBuf>) -> Self {
        Self { place: Place::FirstFree(path.into()), existing: Existing::Keep }
    }

    /// The same, with what becomes of a model that is there.
    pub fn existing(self, existing: Existing) -> Self {
        Self { existing, ..self }
    }

    /// Fails if the folder is there and may not be used, as the scene's own may not; changes nothing.
    ///
    /// # Errors
    /// [`BuildError::IsScene`]; [`BuildError::Output`] where another training writes into it, or where it holds a model that may
    /// not be replaced.
    pub fn check(&self, scene: Option<&Path>) -> Result<(), BuildError> {
        let Place::At(path) = &self.place else { return Ok(()) };
        if !path.exists() {
            return Ok(());
        }
        if scene.is_some_and(|scene| files::is_same(scene, path)) {
            return Err(BuildError::IsScene { path: path.clone() });
        }
        OutputFolder::at(path).lock()?;
        if !(self.existing == Existing::Replace && path.is_dir()) {
            OutputFolder::create(path, Existing::Keep)?;
        }
        Ok(())
    }

    /// Creates and locks the folder, and writes the files that are known before the training; removes a new folder if that
    /// fails.
    ///
    /// # Errors
    /// [`BuildError::Output`] as [`Output::check`], [`BuildError::Write`] where it cannot be made.
    pub fn create(&self, config: &TrainConfig, dataset: &Dataset) -> Result<(OutputFolder, FolderLock), BuildError> {
        let path = self.path();
        let is_new = !path.exists();
        files::create_folder(&path)?;
        // Before anything in it is removed.
        let lock = OutputFolder::at(&path).lock()?;
        let folder = OutputFolder::create(&path, self.existing)?;
        if let Err(error) = folder.write_start(config, dataset) {
            if is_new {
                let _ = fs::remove_dir_all(&path);
            }
            return Err(error.into());
        }
        Ok((folder, lock))
    }

    fn path(&self) -> PathBuf {
        let first = match &self.place {
            Place::At(path) => return path.clone(),
            Place::FirstFree(first) => first,
        };
        let (mut path, mut number) = (first.clone(), 1_u64);
        while self.existing == Existing::Keep && path.exists() {
            number += 1;
            path.clone_from(first);
            path.as_mut_os_string().push(format!("-{number}"));
        }
        path
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_that_is_there_is_passed_over_unless_it_may_be_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let [first, second, third] = ["scene", "scene-2", "scene-3"].map(|name| folder.path().join(name));
        let free = Output::first_free(&first);
        assert_eq!(free.path(), first);
        fs::create_dir(&first).unwrap();
        assert_eq!(free.path(), second);
        fs::create_dir(&second).unwrap();
        assert_eq!(free.path(), third);
        assert_eq!(free.existing(Existing::Replace).path(), first);
    }
}
