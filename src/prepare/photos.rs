//! The photos of a folder: finding them, bringing them and their masks into a scene.

use super::upright::{asks_to_turn, upright};
use super::{is_photo, known_extensions};
use anyhow::{Context, Result};
use ibgs_core::counted;
use ibgs_core::dataset::{has_extension, is_mask};
use ibgs_core::progress::Progress;
use std::fs;
use std::path::{Path, PathBuf};

/// Photos that neither COLMAP nor we read, with the name of their format and a program that converts them.
const UNREAD: [(&[&str], &str, &str); 3] =
    [(&["heic", "heif", "hif"], "HEIC", "heif-convert"), (&["avif"], "AVIF", "avifdec"), (&["jxl"], "JPEG XL", "djxl")];

/// A folder of masks among photos.
const MASKS: &str = "masks";

/// The visible files of a folder, sorted; empty for a video.
fn files_in(folder: &Path) -> Result<Vec<PathBuf>> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let entries = fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))?;
    let mut files = Vec::new();
    for entry in entries {
        let path = entry.with_context(|| format!("cannot read {}", folder.display()))?.path();
        let is_hidden = path.file_name().is_none_or(|name| name.to_string_lossy().starts_with('.'));
        if path.is_file() && !is_hidden {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

/// The files of a folder that are no photos we take.
pub(super) fn left_out(folder: &Path) -> Result<Vec<PathBuf>> {
    Ok(files_in(folder)?.into_iter().filter(|path| !is_photo(path)).collect())
}

/// What to do with photos in a format that is not read, the first such format.
pub(super) fn unread_note(folder: &Path, left_out: &[PathBuf]) -> Option<String> {
    let of = |extensions: &'static [&str]| left_out.iter().filter(move |path| has_extension(path, extensions));
    let (extensions, format, converter) =
        UNREAD.into_iter().find(|(extensions, ..)| of(extensions).next().is_some())?;
    let first = of(extensions).next()?.file_name()?.to_string_lossy();
    let count = of(extensions).count();
    Some(format!(
        "{} has {}, such as {first}, which cannot be read: convert them to JPEG, for example with \
         `{converter}`",
        folder.display(),
        counted(count, &format!("{format} photo"))
    ))
}

/// The visible pictures of a folder and of the folders in it; without those in `masks`.
fn pictures_below(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut pictures = Vec::new();
    let entries = fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))?;
    for entry in entries {
        let path = entry.with_context(|| format!("cannot read {}", folder.display()))?.path();
        if path.file_name().is_none_or(|name| name.to_string_lossy().starts_with('.')) {
            continue;
        }
        if !path.is_dir() {
            pictures.extend(is_photo(&path).then_some(path));
        } else if !path.ends_with(MASKS) {
            pictures.extend(pictures_below(&path)?);
        }
    }
    pictures.sort();
    Ok(pictures)
}

/// The visible photos of a folder and of the folders in it; masks are none.
pub(super) fn photos_below(folder: &Path) -> Result<Vec<PathBuf>> {
    Ok(pictures_below(folder)?.into_iter().filter(|path| !is_mask(path)).collect())
}

/// The masks of a folder's photos, with their names in a folder of masks: those beside the photos and those in `masks`.
fn masks_below(folder: &Path) -> Result<Vec<(PathBuf, PathBuf)>> {
    let named = |from: &Path, path: PathBuf| (path.clone(), path.strip_prefix(from).unwrap_or(&path).to_owned());
    let beside = pictures_below(folder)?.into_iter().filter(|path| is_mask(path));
    let mut masks: Vec<_> = beside.map(|path| named(folder, path)).collect();
    let inner = folder.join(MASKS);
    if inner.is_dir() {
        masks.extend(pictures_below(&inner)?.into_iter().map(|path| named(&inner, path)));
    }
    Ok(masks)
}

/// Links, or where that cannot be copies, a file; one that is there stays.
fn link(path: &Path, target: &Path) -> Result<()> {
    if !target.exists() && fs::hard_link(path, target).is_err() {
        fs::copy(path, target).with_context(|| format!("cannot copy {}", path.display()))?;
    }
    Ok(())
}

fn create_folder_of(target: &Path) -> Result<()> {
    let folder = target.parent().unwrap_or(target);
    fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))
}

/// Brings photos of a folder and of the folders in it to another one: turned where EXIF asks for it, else as links or
/// copies. Gives notes on what was turned and on what is left out.
pub(super) fn copy(from: &Path, photos: &[PathBuf], to: &Path, progress: &dyn Progress) -> Result<Vec<String>> {
    let (mut turned, mut failed) = (0, Vec::new());
    progress.begin("photos", photos.len());
    for path in photos {
        let target = to.join(path.strip_prefix(from).unwrap_or(path));
        create_folder_of(&target)?;
        if asks_to_turn(path) && !target.exists() {
            match upright(path) {
                Ok(bytes) => {
                    fs::write(&target, bytes).with_context(|| format!("cannot write {}", target.display()))?;
                    turned += 1;
                }
                Err(error) => failed.push(format!("{} ({error:#})", path.display())),
            }
        }
        link(path, &target)?;
        progress.step();
    }
    progress.end();
    let mut notes = Vec::new();
    if turned > 0 {
        notes.push(format!(
            "{}: {turned} of {} photos are turned upright in the scene, as their EXIF orientation asks; the originals stay \
             as they are",
            from.display(),
            photos.len()
        ));
    }
    if let Some(first) = failed.first() {
        notes.push(format!("{} with an EXIF orientation could not be turned: {first}", counted(failed.len(), "photo")));
    }
    let left_out = left_out(from)?;
    if let Some(first) = left_out.first().and_then(|path| path.file_name()) {
        notes.push(format!(
            "{}: {} left out, such as {}; photos are {}",
            from.display(),
            counted(left_out.len(), "file"),
            first.to_string_lossy(),
            known_extensions()
        ));
    }
    notes.extend(unread_note(from, &left_out));
    Ok(notes)
}

/// Brings the masks of a folder's photos into a scene's folder of masks, where COLMAP does not take them for photos.
pub(super) fn copy_masks(from: &Path, to: &Path) -> Result<Option<String>> {
    let masks = masks_below(from)?;
    for (path, name) in &masks {
        let target = to.join(name);
        create_folder_of(&target)?;
        link(path, &target)?;
    }
    Ok((!masks.is_empty())
        .then(|| format!("{}: {} brought to {}", from.display(), counted(masks.len(), "mask"), to.display())))
}

/// Notes on photos that lie in the scene already and stay as they are.
pub(super) fn notes_on_own(images: &Path, photos: &[PathBuf]) -> Result<Vec<String>> {
    let mut notes = Vec::new();
    let turned = photos.iter().filter(|path| asks_to_turn(path)).count();
    if turned > 0 {
        notes.push(format!(
            "{turned} of {} photos have an EXIF orientation and stay as they are, since they are your originals: their \
             scene may lie on its side; to have them turned, prepare them into another folder",
            photos.len()
        ));
    }
    let masks = masks_below(images)?.len();
    if masks > 0 {
        notes.push(format!(
            "{masks} masks lie among the photos, where COLMAP takes them for photos: move them to {}",
            images.with_file_name(MASKS).display()
        ));
    }
    Ok(notes)
}
