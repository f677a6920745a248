//! Model folders: what to do about one that is taken, and how a training in one is resumed.

use ibgs_core::output::OutputError;
use std::path::Path;

/// A path as a shell reads it.
pub fn quoted(path: &Path) -> String {
    let path = path.to_string_lossy();
    shlex::try_quote(&path).map_or_else(|_| path.to_string(), Into::into)
}

/// The command that resumes the training in a folder.
pub fn resume(folder: &Path) -> String {
    format!("`ibgs train --resume -m {}`", quoted(folder))
}

/// What to do about a folder.
pub fn advice(error: &OutputError) -> Option<String> {
    let advice = match error {
        OutputError::HoldsModel { .. } => "choose another folder, or allow overwriting it (`--overwrite`)",
        OutputError::HoldsTraining { path, .. } => {
            let resume = resume(path);
            return Some(format!(
                "resume it ({resume}), choose another folder, or allow overwriting it (`--overwrite`)"
            ));
        }
        OutputError::Foreign { .. } => "choose another output folder, or allow overwriting it (`--overwrite`)",
        _ => return None,
    };
    Some(advice.to_owned())
}
