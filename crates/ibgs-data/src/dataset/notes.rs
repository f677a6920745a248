//! Sentences about a scene's photos that its loading and its description share.

use super::info::some_of;
use crate::counted;
use std::path::PathBuf;

/// On photos that are listed and do not exist; `found` others do.
pub(crate) fn missing(missing: &[PathBuf], found: usize) -> Option<String> {
    let names: Vec<String> = missing.iter().map(|path| path.display().to_string()).collect();
    let all = missing.len() + found;
    let note = || format!("{} of {all} photos do not exist and were skipped: {}", missing.len(), some_of(&names));
    (!missing.is_empty()).then(note)
}

/// On photos that no camera is known for.
pub(crate) fn unposed(unposed: &[String]) -> Option<String> {
    let verbs = if unposed.len() == 1 { "has no pose and is" } else { "have no pose and are" };
    let note = || format!("{} {verbs} not used: {}", counted(unposed.len(), "photo"), some_of(unposed));
    (!unposed.is_empty()).then(note)
}

/// On photos that other programs show turned or mirrored.
pub(crate) fn turned(names: &[String]) -> Option<String> {
    let has = if names.len() == 1 { "has" } else { "have" };
    let note = || {
        format!(
            "{} {has} an EXIF orientation that asks for turned pixels: {}; the pixels are used as the files store them, \
             since the poses belong to those; where the poses were estimated from turned photos, save the photos turned",
            counted(names.len(), "photo"),
            some_of(names)
        )
    };
    (!names.is_empty()).then(note)
}
