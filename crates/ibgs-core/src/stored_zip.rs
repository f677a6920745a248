//! Our own ZIP archives, bundles and checkpoints: nothing in them is compressed, and their sums tell damage.

use std::io::{self, Read, Seek, Write};
use zip::result::ZipError;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipArchive, ZipWriter};

/// Writes an archive by its parts.
pub fn write<W: Write + Seek>(out: W, parts: impl FnOnce(&mut ZipWriter<W>) -> io::Result<()>) -> io::Result<()> {
    let mut zip = ZipWriter::new(out);
    if let Err(error) = parts(&mut zip).and_then(|()| zip.flush()) {
        // Dropped it would try to finish the archive, and complain aloud.
        std::mem::forget(zip);
        return Err(error);
    }
    zip.finish().map_err(io::Error::from).map(|_| ())
}

/// Adds a part as it is, without the time of day: equal contents make equal files.
pub fn add<W: Write + Seek>(zip: &mut ZipWriter<W>, part: &str, bytes: &[u8]) -> io::Result<()> {
    let options = SimpleFileOptions::default()
        .compression_method(CompressionMethod::Stored)
        .last_modified_time(DateTime::default())
        .large_file(bytes.len() as u64 >= u64::from(u32::MAX));
    zip.start_file(part, options)?;
    zip.write_all(bytes)
}

/// An open archive. Errors are what is wrong.
pub struct StoredZip<R>(ZipArchive<R>);

impl<R: Read + Seek> StoredZip<R> {
    /// Reads the list of parts.
    pub fn open(reader: R) -> Result<Self, String> {
        ZipArchive::new(reader).map(Self).map_err(|error| error.to_string())
    }

    /// Whether there is such a part.
    pub fn has(&self, part: &str) -> bool {
        self.0.index_for_name(part).is_some()
    }

    /// A part: `is missing` or `cannot be read (why)` otherwise. It is no larger than the file.
    pub fn bytes(&mut self, part: &str) -> Result<Vec<u8>, String> {
        let mut bytes = Vec::new();
        let outcome = self.0.by_name(part).and_then(|mut entry| match entry.compression() {
            CompressionMethod::Stored => Ok(entry.read_to_end(&mut bytes)?),
            _ => Err(ZipError::UnsupportedArchive("it is compressed, which no part of such a file is")),
        });
        match outcome {
            Ok(_) => Ok(bytes),
            Err(ZipError::FileNotFound) => Err("is missing".to_owned()),
            Err(error) => Err(format!("cannot be read ({error})")),
        }
    }
}
