//! The pictures of SOG files, see [`super::sog`]: in an archive, or in a folder.

use crate::dataset::names;
use image_webp::WebPDecoder;
use std::fs::File;
use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};
use zip::ZipArchive;

/// Largest `meta.json`.
pub(super) const MOST_META: u64 = 1 << 20;

pub(super) struct Picture {
    pub(super) width: usize,
    pub(super) pixels: Vec<[u8; 4]>,
}

/// The pictures of a file, and how many bytes may still be unpacked.
pub(super) struct Parts<'a> {
    place: Place<'a>,
    left: u64,
}

enum Place<'a> {
    Archive(ZipArchive<Cursor<&'a [u8]>>),
    Folder(PathBuf),
}

impl<'a> Parts<'a> {
    /// Of a ZIP archive.
    ///
    /// # Errors
    /// It is none.
    pub(super) fn of_archive(bytes: &'a [u8]) -> Result<Self, String> {
        let zip =
            ZipArchive::new(Cursor::new(bytes)).map_err(|error| format!("it is no whole ZIP archive ({error})"))?;
        // Pictures do not compress, so an archive holds hardly more than its own length.
        Ok(Self { place: Place::Archive(zip), left: 2 * bytes.len() as u64 + MOST_META })
    }

    /// Of the folder of a file; [`Parts::limit`] must say how much is read.
    pub(super) fn beside(path: &Path) -> Self {
        Self { place: Place::Folder(path.parent().unwrap_or(Path::new("")).to_owned()), left: 0 }
    }

    /// Allows so many bytes to be read.
    pub(super) fn limit(&mut self, bytes: u64) {
        self.left = bytes;
    }

    /// The length of a file in the folder; 0 in an archive.
    ///
    /// # Errors
    /// There is none.
    pub(super) fn length(&self, name: &str) -> Result<u64, String> {
        match &self.place {
            Place::Archive(_) => Ok(0),
            Place::Folder(folder) => {
                let metadata = open(folder, name)?.metadata();
                metadata.map(|metadata| metadata.len()).map_err(|error| unreadable(name, &error))
            }
        }
    }

    /// The text `meta.json` of an archive.
    ///
    /// # Errors
    /// It is missing or too long.
    pub(super) fn meta(&mut self) -> Result<Vec<u8>, String> {
        self.bytes("meta.json", MOST_META)
    }

    fn bytes(&mut self, name: &str, most: u64) -> Result<Vec<u8>, String> {
        if name.contains(char::is_control) {
            return Err(format!("its picture `{}` has a name that no file has", name.escape_debug()));
        }
        let mut bytes = Vec::new();
        let read = match &mut self.place {
            Place::Archive(zip) => {
                let entry = zip.by_name(name).map_err(|error| unreadable(name, &error))?;
                entry.take(most + 1).read_to_end(&mut bytes)
            }
            Place::Folder(folder) => open(folder, name)?.take(most + 1).read_to_end(&mut bytes),
        };
        read.map_err(|error| unreadable(name, &error))?;
        if bytes.len() as u64 > most {
            return Err(format!("its `{name}` unpacks to more than {most} bytes"));
        }
        self.left -= (bytes.len() as u64).min(self.left);
        Ok(bytes)
    }

    /// A picture of at least `count` pixels and not many more.
    ///
    /// # Errors
    /// What is wrong with it.
    pub(super) fn plane(&mut self, name: &str, count: usize) -> Result<Vec<[u8; 4]>, String> {
        let pixels = self.picture(name, count)?.pixels;
        if pixels.len() < count {
            return Err(format!("its `{name}` has {} pixels where {count} are needed", pixels.len()));
        }
        Ok(pixels)
    }

    /// A picture for `count` values; its size is checked before it is unpacked.
    ///
    /// # Errors
    /// What is wrong with it.
    pub(super) fn picture(&mut self, name: &str, count: usize) -> Result<Picture, String> {
        let wrong = |error: &dyn std::fmt::Display| format!("its `{name}` is no lossless WebP picture ({error})");
        let bytes = self.bytes(name, self.left)?;
        let mut decoder = WebPDecoder::new(Cursor::new(bytes.as_slice())).map_err(|error| wrong(&error))?;
        let (width, height) = decoder.dimensions();
        let size = u64::from(width) * u64::from(height);
        // Sides are rounded up to whole blocks of pixels; a palette has 64 entries of up to 15 pixels a row.
        let most = 16 * count as u64 + 16 * u64::from(width.max(64));
        if size > most {
            return Err(format!("its `{name}` has {width} x {height} pixels, far more than its {count} values need"));
        }
        let (channels, pixels) = (if decoder.has_alpha() { 4 } else { 3 }, size as usize);
        let mut data = vec![0; channels * pixels];
        decoder.read_image(&mut data).map_err(|error| wrong(&error))?;
        let rgba = |v: &[u8]| [v[0], v[1], v[2], v.get(3).copied().unwrap_or(255)];
        Ok(Picture { width: width as usize, pixels: data.chunks_exact(channels).map(rgba).collect() })
    }
}

/// The name of a file in its folder.
///
/// # Errors
/// It leads out of it.
pub(super) fn inside(name: &str) -> Result<String, String> {
    let inside = names::inside(name, |_| false);
    inside.map(|inside| inside.name).ok_or_else(|| format!("its `{}` leads out of its folder", name.escape_debug()))
}

fn open(folder: &Path, name: &str) -> Result<File, String> {
    File::open(folder.join(inside(name)?)).map_err(|error| unreadable(name, &error))
}

pub(super) fn unreadable(name: &str, error: &dyn std::fmt::Display) -> String {
    format!("its `{}` cannot be read ({error})", name.escape_debug())
}
