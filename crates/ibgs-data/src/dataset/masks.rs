//! Masks in files: how programs name them, those that belong to no photo, and those of another shape than their photo.

use super::DatasetError;
use super::info::{path_inside, some_of};
use super::names::{find_photo, photos_below, without_extension};
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// The folder of masks in a scene.
const FOLDER: &str = "masks";

/// What stands behind the name of the photo in that of its mask, before the extension: nothing in COLMAP's names, `.mask`
/// in RealityScan's, `_mask` in Metashape's.
const SUFFIXES: [&str; 3] = ["", ".mask", "_mask"];

/// One pixel of rounding moves the ratio of the sides by less than 2 % for any photo worth loading.
pub(crate) const SAME_SHAPE: f64 = 0.02;

/// The mask of a photo's name in a folder, with one of these suffixes.
fn find_in(folder: &Path, name: &str, suffixes: &[&str]) -> Option<PathBuf> {
    let bases = [name, without_extension(name)];
    let names = suffixes.iter().flat_map(|suffix| bases.map(|base| format!("{base}{suffix}")));
    names.into_iter().find_map(|name| {
        let with_png = folder.join(format!("{name}.png"));
        if with_png.is_file() { Some(with_png) } else { find_photo(folder, &name) }
    })
}

/// Finds the masks of a scene. It looks once into each folder whether it holds masks at all.
pub(crate) struct MaskFinder<'a> {
    scene: &'a Path,
    /// The folder of masks, where it is there.
    folder: Option<PathBuf>,
    /// Whether a folder has masks beside photos.
    beside: RefCell<BTreeMap<PathBuf, bool>>,
}

impl<'a> MaskFinder<'a> {
    pub fn new(scene: &'a Path) -> Self {
        Self { scene, folder: Some(scene.join(FOLDER)).filter(|folder| folder.is_dir()), beside: RefCell::default() }
    }

    /// The mask of an image in `masks/`, else beside its photo. `name` is the image's name, which may begin with the photo
    /// folder; `photo` is its file.
    pub fn find(&self, name: &str, photo: &Path) -> Option<PathBuf> {
        let file = path_inside(self.scene, photo);
        let by_file = file.split_once('/').map(|(_, inner)| inner);
        let mut names = [Some(name), by_file, name.strip_prefix("images/")].into_iter().flatten();
        let in_folder = self.folder.as_ref().and_then(|folder| names.find_map(|name| find_in(folder, name, &SUFFIXES)));
        // Reduced photos have the masks of the whole ones.
        let beside = || [photo.to_owned(), self.scene.join("images").join(name), self.scene.join(name)];
        in_folder.or_else(|| {
            beside().iter().find_map(|photo| {
                let folder = photo.parent().filter(|folder| self.has_masks(folder))?;
                find_in(folder, photo.file_name()?.to_str()?, &SUFFIXES[1..])
            })
        })
    }

    fn has_masks(&self, folder: &Path) -> bool {
        if let Some(&known) = self.beside.borrow().get(folder) {
            return known;
        }
        let names = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.file_name());
        let has = names.into_iter().any(|name| name.to_string_lossy().to_lowercase().contains("mask"));
        self.beside.borrow_mut().insert(folder.to_owned(), has);
        has
    }
}

/// Whether a picture is the mask of a photo beside it, by its name: `a.jpg.mask.png`, `a.mask.png`, `a.jpg_mask.png` or
/// `a_mask.png` beside `a.jpg`.
pub fn is_mask(path: &Path) -> bool {
    let (Some(folder), Some(stem)) = (path.parent(), path.file_stem().and_then(|stem| stem.to_str())) else {
        return false;
    };
    let is_of = |suffix: &&str| stem.strip_suffix(*suffix).is_some_and(|photo| find_photo(folder, photo).is_some());
    SUFFIXES[1..].iter().any(is_of)
}

/// A note on the files in `masks/` that belong to no photo; `used` are the masks of the photos.
pub(crate) fn unfit_note<'a>(scene: &Path, used: impl Iterator<Item = &'a Path>) -> Option<String> {
    // Where a file system takes `A.PNG` for `a.png`, a mask may be found under another spelling.
    let key = |path: &Path| path_inside(scene, path).to_lowercase();
    let used: BTreeSet<String> = used.map(key).collect();
    let files = photos_below(&scene.join(FOLDER));
    let unfit = files.iter().filter(|path| !used.contains(&key(path)));
    let unfit: Vec<String> = unfit.map(|path| path_inside(scene, path)).collect();
    let note = || {
        format!(
            "{} of {} files in {FOLDER} belong to no photo with a pose and are not used: {}; a mask of a.jpg is named \
             a.png, a.mask.png or a_mask.png, or the same with a.jpg in place of a",
            unfit.len(),
            files.len(),
            some_of(&unfit)
        )
    };
    (!unfit.is_empty()).then(note)
}

/// Refuses a mask of another shape than its photo; one of another size alone is resized.
pub(crate) fn check_shape(
    (mask, size): (&Path, (u32, u32)),
    (photo, photo_size): (&Path, (u32, u32)),
) -> Result<(), DatasetError> {
    let ratio = |(width, height): (u32, u32)| f64::from(width) / f64::from(height);
    if (ratio(size) / ratio(photo_size) - 1.0).abs() <= SAME_SHAPE {
        return Ok(());
    }
    Err(DatasetError::MaskShape { path: mask.to_owned(), size, photo: photo.to_owned(), photo_size })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_have_the_names_that_programs_give_them() {
        let folder = tempfile::tempdir().unwrap();
        let scene = folder.path();
        let write = |name: &str| {
            let path = scene.join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, "").unwrap();
            path
        };
        let photo = write("images/left/a.v2.jpg");
        // The later ones win.
        for mask in [
            "images/left/a.v2_mask.png",
            "images/left/a.v2.jpg_mask.PNG",
            "images/left/a.v2.mask.png",
            "images/left/a.v2.jpg.mask.png",
            "masks/left/a.v2_mask.tif",
            "masks/left/a.v2.jpg_mask.png",
            "masks/left/a.v2.mask.jpg",
            "masks/left/a.v2.jpg.mask.png",
            "masks/left/a.v2.png",
            "masks/left/a.v2.jpg",
            "masks/left/a.v2.jpg.png",
        ] {
            let expected = write(mask);
            for name in ["left/a.v2.jpg", "images/left/a.v2.jpg", "a.v2.jpg"] {
                let found = MaskFinder::new(scene).find(name, &photo);
                assert_eq!(found, Some(expected.clone()), "{mask} for {name}");
            }
            assert_eq!(is_mask(&expected), mask.starts_with("images"), "{mask}");
        }
        assert!(!is_mask(&photo) && !is_mask(&write("images/left/b_mask.png")), "there is no photo b");
    }
}
