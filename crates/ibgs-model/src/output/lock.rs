//! One training a folder.

use super::{OutputError, OutputFolder};
use std::fs::{File, TryLockError};

/// Keeps other trainings out of a folder while it lives; the operating system frees it with the process.
#[derive(Debug)]
pub struct FolderLock {
    /// The folder itself: no file is left behind. None where the system has no such locks.
    _folder: Option<File>,
}

impl OutputFolder {
    /// Locks the folder, which must be there.
    ///
    /// # Errors
    /// [`OutputError::Busy`] while another training writes into it, [`OutputError::Read`] when it cannot be opened.
    pub fn lock(&self) -> Result<FolderLock, OutputError> {
        // Elsewhere folders are no files that can be opened.
        if !cfg!(unix) {
            return Ok(FolderLock { _folder: None });
        }
        let path = self.root();
        let folder = File::open(path).map_err(|source| OutputError::Read { path: path.to_owned(), source })?;
        match folder.try_lock() {
            Ok(()) => Ok(FolderLock { _folder: Some(folder) }),
            Err(TryLockError::WouldBlock) => Err(OutputError::Busy { path: path.to_owned() }),
            // Some network file systems have no locks.
            Err(TryLockError::Error(_)) => Ok(FolderLock { _folder: None }),
        }
    }
}
