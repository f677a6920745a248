//! A scene in a ZIP archive: unpacked into a temporary folder, which is removed once the photos have been read, or, where they do not fit into the
//! host's memory, once they are no longer needed.

use super::names::clean_name;
use super::{DatasetError, Loaders};
use std::fs::{self, File};
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};
use tempfile::TempDir;
use zip::ZipArchive;

/// Limit on the unpacked size: this many times the archive's own size, plus this many bytes. Photos hardly shrink, and
/// COLMAP's text files shrink to a fifth.
const MOST_TIMES: u64 = 20;
const MOST_BYTES_MORE: u64 = 64 << 20;

/// Most folders above a file.
const MOST_FOLDERS: u64 = 32;

/// What an empty file or a folder takes on the disk.
const BLOCK: u64 = 4096;

/// Files that file managers add.
const CLUTTER: [&str; 3] = ["__MACOSX", ".DS_Store", "Thumbs.db"];

/// Bits of a Unix mode that distinguish files, folders and links.
const KIND: u32 = 0o170_000;
const PLAIN: [u32; 3] = [0, 0o100_000, 0o040_000];

/// Whether a path names a ZIP archive, by its extension.
pub fn is_archive(path: &Path) -> bool {
    path.is_file() && path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("zip"))
}

/// An unpacked archive; dropping it removes its files.
pub(crate) struct Unpacked {
    archive: PathBuf,
    folder: TempDir,
}

impl Unpacked {
    /// Unpacks an archive of plain files and folders.
    pub fn new(path: &Path) -> Result<Unpacked, DatasetError> {
        let refuse = |problem: String| DatasetError::Archive { path: path.to_owned(), problem };
        let file = File::open(path).map_err(|cause| DatasetError::read(path, &cause))?;
        let size = file.metadata().map_err(|cause| DatasetError::read(path, &cause))?.len();
        let broken = |error: zip::result::ZipError| refuse(format!("it is no whole ZIP archive ({error})"));
        let mut zip = ZipArchive::new(BufReader::new(file)).map_err(broken)?;
        let folder = tempfile::Builder::new().prefix("ibgs-scene-").tempdir();
        let folder = folder.map_err(|cause| refuse(format!("no temporary folder can be made for it ({cause})")))?;
        let most = size.saturating_mul(MOST_TIMES).saturating_add(MOST_BYTES_MORE);
        let mut left = most;
        for index in 0..zip.len() {
            let bytes = unpack_entry(&mut zip, index, folder.path(), left).map_err(refuse)?;
            left = left.checked_sub(bytes).ok_or_else(|| {
                refuse(format!(
                    "it unpacks to more than {most} bytes ({MOST_TIMES} times its size and {} MiB), which no scene does",
                    MOST_BYTES_MORE >> 20
                ))
            })?;
        }
        Ok(Unpacked { archive: path.to_owned(), folder })
    }

    /// The scene's folder: the archive's own, or the only folder in it.
    pub fn root(&self, loaders: &Loaders) -> PathBuf {
        let top = self.folder.path().to_owned();
        let entries = || fs::read_dir(&top).into_iter().flatten().flatten().map(|entry| entry.path());
        match entries().next() {
            Some(only) if only.is_dir() && entries().count() == 1 && loaders.of(&top).is_err() => only,
            _ => top,
        }
    }

    /// An error of the files, with the archive's name in its message.
    pub fn error(&self, error: DatasetError) -> DatasetError {
        DatasetError::InArchive { message: self.named(&error.to_string()), error: Box::new(error) }
    }

    /// A message about the files with the archive's name in place of the temporary folder's.
    pub fn named(&self, message: &str) -> String {
        message.replace(&self.folder.path().display().to_string(), &self.archive.display().to_string())
    }
}

/// Unpacks one entry; returns the bytes that it takes on the disk, or a value above `most` if it takes more than that.
fn unpack_entry(zip: &mut ZipArchive<BufReader<File>>, index: usize, folder: &Path, most: u64) -> Result<u64, String> {
    let entry = zip.by_index_raw(index).map_err(|error| format!("entry {index} is damaged ({error})"))?;
    let name = String::from_utf8_lossy(entry.name_raw()).into_owned();
    let about = |problem: &str| format!("its entry `{}` {problem}", name.escape_default());
    let inside = clean_name(&name).ok_or_else(|| about("is absolute or contains `..`"))?;
    if inside.split('/').any(|part| CLUTTER.contains(&part)) {
        return Ok(0);
    }
    if entry.unix_mode().is_some_and(|mode| !PLAIN.contains(&(mode & KIND))) {
        return Err(about("is a link or no plain file"));
    }
    if entry.encrypted() {
        return Err(about("is encrypted"));
    }
    // A name of 4 KB can ask for 2000 folders.
    let folders = inside.split('/').count() as u64 - 1;
    if folders > MOST_FOLDERS {
        return Err(format!("it has an entry {folders} folders deep, more than {MOST_FOLDERS}"));
    }
    let blocks = BLOCK * folders;
    let Some(most) = most.checked_sub(blocks) else { return Ok(blocks) };
    let path = folder.join(inside);
    let unwritable = |cause: io::Error| about(&format!("cannot be unpacked to {} ({cause})", folder.display()));
    if entry.is_dir() {
        return fs::create_dir_all(path).map(|()| blocks + BLOCK).map_err(unwritable);
    }
    if entry.size() > most {
        return Ok(entry.size().saturating_add(blocks));
    }
    drop(entry);
    let entry = zip.by_index(index).map_err(|error| about(&format!("cannot be read ({error})")))?;
    path.parent().map_or(Ok(()), fs::create_dir_all).map_err(unwritable)?;
    let mut file = File::create_new(path).map_err(unwritable)?;
    // Sizes in the archive may lie.
    let written = io::copy(&mut entry.take(most.saturating_add(1)), &mut file);
    written.map(|bytes| bytes + blocks).map_err(|cause| about(&format!("cannot be unpacked ({cause})")))
}
