//! Names of files in a scene, and which file each means. No name leads out of the scene folder.

use super::{LoadOptions, Resolution};
use std::path::{Path, PathBuf};

/// Extensions of photos that are read, in lower case. A photo is found under any of them in this order, in lower or upper
/// case: folders of reduced photos often hold PNG files where the scene names JPEG files.
pub const PHOTO_EXTENSIONS: [&str; 7] = ["jpg", "jpeg", "png", "exr", "webp", "tif", "tiff"];

/// Those of them whose values are colours of a screen. An EXR file has linear values without a limit, which must be converted
/// before a program can show them or find features in them.
pub fn picture_extensions() -> Vec<&'static str> {
    PHOTO_EXTENSIONS.into_iter().filter(|extension| *extension != "exr").collect()
}

/// Extensions of photos that are not read, in lower case.
const UNREAD: [&str; 5] = ["heic", "heif", "hif", "avif", "jxl"];

/// Longest suffix of an absolute name that is searched for inside the scene, in path components.
const MOST_PARTS: usize = 32;

/// Folders below a photo folder that are searched for photos.
const MOST_DEEP: usize = 8;

fn is_one_of(extension: &str, known: &[&str]) -> bool {
    known.iter().any(|known| extension.eq_ignore_ascii_case(known))
}

/// Whether a path has one of these extensions, in any case.
pub fn has_extension(path: &Path, known: &[&str]) -> bool {
    let extension = path.extension().and_then(|extension| extension.to_str());
    extension.is_some_and(|extension| is_one_of(extension, known))
}

fn is_photo(path: &Path) -> bool {
    has_extension(path, &PHOTO_EXTENSIONS) || has_extension(path, &UNREAD)
}

/// The components of a name, separated by `/` or `\`, without empty ones and `.`.
fn parts(name: &str) -> Vec<String> {
    let name = name.trim().replace('\\', "/");
    name.split('/').filter(|part| !matches!(*part, "" | ".")).map(str::to_owned).collect()
}

/// Windows takes `.. ` and `...` for `..`.
fn leaves(part: &str) -> bool {
    part.trim_matches(['.', ' ']).is_empty() || part.contains('\0')
}

fn has_drive(name: &str) -> bool {
    name.as_bytes().get(1) == Some(&b':')
}

fn is_absolute(name: &str) -> bool {
    let name = name.trim();
    name.starts_with(['/', '\\']) || has_drive(name)
}

/// The name with `/` as separator and without leading `./`, or none when it leaves its folder.
pub(crate) fn clean_name(name: &str) -> Option<String> {
    let parts = parts(name);
    let leaves = is_absolute(name) || parts.is_empty() || parts.iter().any(|part| leaves(part));
    (!leaves).then(|| parts.join("/"))
}

/// The name of a folder as [`clean_name`] has it; `.` is the scene folder itself.
pub(crate) fn clean_folder(name: &str) -> Option<String> {
    let is_top = !is_absolute(name) && !name.trim().is_empty() && parts(name).is_empty();
    if is_top { Some(".".to_owned()) } else { clean_name(name) }
}

/// A name by which two spellings of it are equal.
pub(crate) fn spelling(name: &str) -> String {
    parts(name).join("/")
}

/// A name in a scene file, brought into the scene.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Inside {
    /// Relative, as [`clean_name`] leaves it.
    pub name: String,
    /// The file has an absolute name, and `name` is a suffix of it.
    pub is_end: bool,
}

/// Maps a name into the scene: a relative name stays as it is, an absolute name becomes its longest suffix that
/// `exists` there. None for a name that leads out of the scene, and for one with control characters, as names appear in
/// messages.
pub(crate) fn inside(name: &str, exists: impl Fn(&str) -> bool) -> Option<Inside> {
    let plain = |name: &String| !name.contains(char::is_control);
    if !is_absolute(name) {
        return clean_name(name).filter(plain).map(|name| Inside { name, is_end: false });
    }
    let mut parts = parts(name);
    if has_drive(name.trim()) && !parts.is_empty() {
        parts.remove(0);
    }
    if parts.iter().any(|part| leaves(part)) {
        return None;
    }
    let ends = (parts.len().saturating_sub(MOST_PARTS)..parts.len()).map(|first| parts[first..].join("/"));
    ends.filter(plain).find(|end| exists(end)).map(|name| Inside { name, is_end: true })
}

/// Whether an absolute name points into a folder, which exists.
pub(crate) fn points_into(folder: &Path, name: &str) -> bool {
    let name = Path::new(name.trim());
    let whole = [folder.canonicalize().ok(), std::path::absolute(folder).ok()];
    whole.into_iter().flatten().any(|folder| name.starts_with(folder))
}

/// A name without the extension of a photo.
pub(crate) fn without_extension(name: &str) -> &str {
    match name.rsplit_once('.') {
        Some((stem, extension)) if is_one_of(extension, &PHOTO_EXTENSIONS) || is_one_of(extension, &UNREAD) => stem,
        _ => name,
    }
}

/// The file behind an image name: as named, with an extension added, or with another extension.
pub(crate) fn find_photo(folder: &Path, name: &str) -> Option<PathBuf> {
    let exact = folder.join(name);
    let extension = name.rsplit_once('.').map_or("", |(_, extension)| extension);
    let is_unread = is_one_of(extension, &UNREAD);
    if !is_unread && exact.is_file() {
        return Some(exact);
    }
    let stem = without_extension(name);
    let others = PHOTO_EXTENSIONS.iter().flat_map(|extension| [(*extension).to_owned(), extension.to_uppercase()]);
    let other = others.map(|extension| folder.join(format!("{stem}.{extension}"))).find(|path| path.is_file());
    other.or_else(|| Some(exact).filter(|exact| is_unread && exact.is_file()))
}

/// What the image names of a format are relative to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RelativeTo {
    /// The photo folder.
    Photos,
    /// The scene folder.
    Scene,
}

/// Where the photos of a scene are looked for.
pub(crate) struct PhotoFolders {
    root: PathBuf,
    names: RelativeTo,
    /// The folder that the user names.
    named: Option<String>,
    /// `images_4` and the like.
    reduced: Option<String>,
}

/// A photo that was looked for.
pub(crate) enum Photo {
    /// Its file, and whether it is a reduced one.
    Found(PathBuf, bool),
    /// Where it should be.
    Missing(PathBuf),
}

/// `images_4` for factor 4, where the scene has it.
fn reduced_folder(scene: &Path, options: &LoadOptions) -> Option<String> {
    match options.resolution {
        Resolution::Factor(factor) if factor > 1 => {
            Some(format!("images_{factor}")).filter(|name| scene.join(name).is_dir())
        }
        _ => None,
    }
}

impl PhotoFolders {
    pub fn new(root: &Path, names: RelativeTo, options: &LoadOptions) -> PhotoFolders {
        let named = options.images.as_deref().and_then(clean_folder);
        let reduced = reduced_folder(root, options).filter(|_| named.is_none());
        PhotoFolders { root: root.to_owned(), names, named, reduced }
    }

    /// The folder that the user names, where it does not exist.
    pub fn absent(&self) -> Option<PathBuf> {
        self.named.as_ref().map(|folder| self.at(folder)).filter(|path| !path.is_dir())
    }

    /// Whether a folder of reduced photos is used.
    pub fn is_reduced(&self) -> bool {
        self.reduced.is_some()
    }

    /// Says which resampler reduced photos went through.
    pub fn reduced_note(&self) -> Option<String> {
        let note = |folder| format!("photos come from {folder} as they are, intrinsics rescaled to them");
        self.reduced.as_ref().map(note)
    }

    /// The folder that should have all photos.
    pub fn main(&self) -> PathBuf {
        self.at(self.named.as_deref().or(self.reduced.as_deref()).unwrap_or("images"))
    }

    fn at(&self, folder: &str) -> PathBuf {
        if folder == "." { self.root.clone() } else { self.root.join(folder) }
    }

    /// Folders and names to try, in this order; none of them is empty.
    fn places(&self, name: &str) -> [(PathBuf, String); 2] {
        let (first, rest) = name.split_once('/').unwrap_or(("", name));
        let plain = |folder: &str| (self.at(folder), name.to_owned());
        let inner = |folder: &str| (self.at(folder), rest.to_owned());
        match (&self.named, &self.reduced, self.names) {
            (Some(folder), _, RelativeTo::Photos) => [plain(folder), inner(folder)],
            (Some(folder), _, RelativeTo::Scene) => [inner(folder), plain(folder)],
            (None, Some(folder), _) if first == "images" => [inner(folder), plain(folder)],
            (None, Some(folder), RelativeTo::Photos) => [plain(folder), plain(folder)],
            (None, _, RelativeTo::Photos) => [plain("images"), plain(".")],
            (None, _, RelativeTo::Scene) => [plain("."), plain("images")],
        }
    }

    /// The photo of an image name.
    pub fn find(&self, name: &str) -> Photo {
        let places = self.places(name);
        let found = places.iter().find_map(|(folder, name)| find_photo(folder, name));
        let [(folder, name), _] = places;
        let is_reduced = self.reduced.as_ref().is_some_and(|reduced| folder == self.at(reduced));
        found.map_or_else(|| Photo::Missing(folder.join(name)), |photo| Photo::Found(photo, is_reduced))
    }

    /// The name inside the scene, and its photo; none for a name that leads out.
    pub fn resolve(&self, name: &str) -> Option<(Inside, Photo)> {
        let inside = inside(name, |end| matches!(self.find(end), Photo::Found(..)))?;
        let photo = self.find(&inside.name);
        Some((inside, photo))
    }
}

/// The photos in a folder, hidden files left out; with those of the folders in it where `depth` is not 0.
fn add_photos(folder: &Path, depth: usize, photos: &mut Vec<PathBuf>) {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    for path in entries.map(|entry| entry.path()) {
        let is_hidden = path.file_name().is_none_or(|name| name.to_string_lossy().starts_with('.'));
        if is_hidden {
            continue;
        }
        if path.is_dir() && depth > 0 {
            add_photos(&path, depth - 1, photos);
        } else if is_photo(&path) && path.is_file() {
            photos.push(path);
        }
    }
}

/// All photos in a folder and the folders in it, sorted.
pub(crate) fn photos_below(folder: &Path) -> Vec<PathBuf> {
    let mut photos = Vec::new();
    add_photos(folder, MOST_DEEP, &mut photos);
    photos.sort();
    photos
}

/// The photos of a folder alone, sorted.
pub(crate) fn photos_in(folder: &Path) -> Vec<PathBuf> {
    let mut photos = Vec::new();
    add_photos(folder, 0, &mut photos);
    photos.sort();
    photos
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn absolute_names_become_their_longest_end_inside() {
        let known = ["images/a.jpg", "a.jpg", "b c/ü.png"];
        let exists = |end: &str| known.contains(&end);
        let end = |name: &str| inside(name, exists).map(|inside| inside.name);
        assert_eq!(end("/home/me/scene/images/a.jpg").as_deref(), Some("images/a.jpg"));
        assert_eq!(end(r"C:\scans\images\a.jpg").as_deref(), Some("images/a.jpg"));
        assert_eq!(end(r"\\server\share\a.jpg").as_deref(), Some("a.jpg"));
        assert_eq!(end("C:a.jpg"), None);
        assert_eq!(end("/x/b c/ü.png").as_deref(), Some("b c/ü.png"));
        assert_eq!(end("/etc/passwd"), None);
        assert_eq!(end("/x/../a.jpg"), None);
        assert_eq!(end("/x/a\u{7}/a.jpg").as_deref(), Some("a.jpg"));
        let relative = inside(r".\images\\a.jpg ", |_| false);
        assert_eq!(relative, Some(Inside { name: "images/a.jpg".to_owned(), is_end: false }));
        assert_eq!(inside("a\u{7}.jpg", |_| true), None);
    }

    #[test]
    fn the_top_folder_is_a_folder_of_photos() {
        for top in [".", "./", " . ", ".//."] {
            assert_eq!(clean_folder(top).as_deref(), Some("."), "{top}");
        }
        assert_eq!(clean_folder("./a/b/").as_deref(), Some("a/b"));
        for out in ["", " ", "..", "a/../..", "/", "/a", "C:", r"\a"] {
            assert_eq!(clean_folder(out), None, "{out}");
        }
    }
}
