//! What was opened before, with small pictures. A thread looks for them: disks can be slow.

use crate::thumbnails::small;
use eframe::egui::{ColorImage, Context, TextureHandle, TextureOptions};
use ibgs_core::dataset::{has_extension, picture_extensions};
use ibgs_core::output::OutputFolder;
use image::RgbaImage;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, channel};

/// Folders of a scene that hold its photos, `.` being the scene itself.
const PHOTO_FOLDERS: [&str; 6] = ["images", "images_2", "images_4", "images_8", "train", "."];
/// Pictures of a model: final images before those of the base, of held-out views before others.
const RENDERS: [(&str, &str); 4] =
    [("test", "renders_aggregate"), ("test", "renders"), ("train", "renders_aggregate"), ("train", "renders")];

/// One of them.
#[derive(Clone)]
pub struct Recent {
    pub path: PathBuf,
    /// It has been looked for.
    is_known: bool,
    /// It was searched for and not found.
    pub is_missing: bool,
    pub picture: Option<TextureHandle>,
}

struct Found {
    index: usize,
    is_missing: bool,
    picture: Option<ColorImage>,
}

/// All of them.
#[derive(Default)]
pub struct Recents {
    all: Vec<Recent>,
    found: Option<Receiver<Found>>,
}

impl Recents {
    /// The entries of these paths, with what has been found of them so far.
    pub fn of(&mut self, paths: &[PathBuf], ctx: &Context) -> &[Recent] {
        if !self.all.iter().map(|recent| &recent.path).eq(paths) {
            let unknown =
                |path: &PathBuf| Recent { path: path.clone(), is_known: false, is_missing: false, picture: None };
            self.all = paths.iter().map(unknown).collect();
            self.found = look_for(paths.to_vec(), ctx.clone());
        }
        while let Some(Ok(found)) = self.found.as_ref().map(Receiver::try_recv) {
            let recent = &mut self.all[found.index];
            let name = recent.path.to_string_lossy();
            (recent.is_known, recent.is_missing) = (true, found.is_missing);
            recent.picture = found.picture.map(|picture| ctx.load_texture(name, picture, TextureOptions::LINEAR));
        }
        &self.all
    }

    /// All have been found, or are missing.
    pub fn is_complete(&self) -> bool {
        self.all.iter().all(|recent| recent.is_known)
    }

    /// Looks for all of them again when they are asked for next.
    pub fn forget(&mut self) {
        *self = Self::default();
    }
}

fn look_for(paths: Vec<PathBuf>, window: Context) -> Option<Receiver<Found>> {
    let (sender, found) = channel();
    let look = move || {
        for (index, path) in paths.iter().enumerate() {
            let picture = picture_file(path).and_then(|file| picture(&file));
            if sender.send(Found { index, is_missing: !path.exists(), picture }).is_err() {
                return;
            }
            window.request_repaint();
        }
    };
    std::thread::Builder::new().name("recent models".to_owned()).spawn(look).ok().map(|_| found)
}

fn picture(file: &Path) -> Option<ColorImage> {
    let whole: RgbaImage = image::open(file).ok()?.into_rgba8();
    Some(small(&whole))
}

/// A picture of what was opened: one that the model rendered, or else a photo of its scene.
fn picture_file(path: &Path) -> Option<PathBuf> {
    let model = OutputFolder::at(path);
    let rendered = RENDERS.iter().find_map(|(split, kind)| first_picture(&latest(&path.join(split))?.join(kind)));
    let photo = |scene: &Path| PHOTO_FOLDERS.iter().find_map(|folder| first_picture(&scene.join(folder)));
    rendered.or_else(|| photo(&model.read_config().ok()?.source?)).or_else(|| photo(path))
}

/// The folder `ours_N` of the largest N.
fn latest(folder: &Path) -> Option<PathBuf> {
    let number = |path: &PathBuf| path.file_name()?.to_str()?.strip_prefix("ours_")?.parse::<u32>().ok();
    entries(folder)?.filter(|path| number(path).is_some()).max_by_key(number)
}

/// The first picture of a folder by name.
fn first_picture(folder: &Path) -> Option<PathBuf> {
    // `image::open` knows no EXR.
    let extensions = picture_extensions();
    let is_picture = |path: &PathBuf| has_extension(path, &extensions);
    entries(folder)?.filter(is_picture).min()
}

fn entries(folder: &Path) -> Option<impl Iterator<Item = PathBuf>> {
    Some(std::fs::read_dir(folder).ok()?.filter_map(|entry| Some(entry.ok()?.path())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_is_found_where_there_is_one() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let write = |name: &str, size: u32| {
            let path = folder.join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            RgbaImage::new(size, size).save(&path).unwrap();
            path
        };
        assert_eq!(picture_file(folder), None);
        let photo = write("scene/images/b.png", 400);
        std::fs::write(folder.join("scene/images/a.txt"), "no picture").unwrap();
        assert_eq!(picture_file(&folder.join("scene")), Some(photo.clone()));
        let old = write("model/test/ours_900/renders/a.png", 4);
        assert_eq!(picture_file(&folder.join("model")), Some(old));
        write("model/test/ours_1000/renders/z.png", 4);
        let last = write("model/test/ours_1000/renders_aggregate/a.png", 4);
        assert_eq!(picture_file(&folder.join("model")), Some(last));
        assert!(picture(&photo).unwrap().size[0] < 400);
        assert!(picture(&folder.join("scene/images/a.txt")).is_none());
    }
}
