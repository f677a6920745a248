//! Our own ZIP archives, bundles and checkpoints: nothing in them is compressed, and their checksums show damage.

use std::io::{self, Cursor, Read, Seek, Write};
use zip::result::ZipError;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipArchive, ZipWriter};

/// Bytes of a part's own header before its name.
const HEADER: usize = 30;

/// Writes an archive by its parts.
pub fn write<W: Write + Seek>(out: W, parts: impl FnOnce(&mut ZipWriter<W>) -> io::Result<()>) -> io::Result<()> {
    let mut zip = ZipWriter::new(out);
    if let Err(error) = parts(&mut zip).and_then(|()| zip.flush()) {
        // If it were dropped, it would try to finish the archive and print an error.
        std::mem::forget(zip);
        return Err(error);
    }
    zip.finish().map_err(io::Error::from).map(|_| ())
}

/// Adds a part as it is, without the time of day: equal contents make equal files.
pub fn add<W: Write + Seek>(zip: &mut ZipWriter<W>, part: &str, bytes: &[u8]) -> io::Result<()> {
    add_large(zip, part, bytes.len() as u64, |zip| zip.write_all(bytes))
}

/// Adds a part of so many bytes, which need not be in memory at once.
pub fn add_large<W: Write + Seek>(
    zip: &mut ZipWriter<W>,
    part: &str,
    bytes: u64,
    contents: impl FnOnce(&mut ZipWriter<W>) -> io::Result<()>,
) -> io::Result<()> {
    zip.start_file(part, options(bytes))?;
    contents(zip)
}

fn options(bytes: u64) -> SimpleFileOptions {
    SimpleFileOptions::default()
        .compression_method(CompressionMethod::Stored)
        .last_modified_time(DateTime::default())
        .large_file(bytes >= u64::from(u32::MAX))
}

/// An archive of the parts before the first one whose name begins with `name`, from the beginning of an archive's bytes; none
/// where that part does not begin within it.
pub fn before(start: &[u8], name: &str) -> Option<Vec<u8>> {
    let mut out = Cursor::new(Vec::new());
    let mut begins = false;
    let written = write(&mut out, |zip| {
        for part in first_parts(start) {
            begins = part.name.starts_with(name);
            if begins || !part.is_whole {
                break;
            }
            add(zip, part.name, part.bytes)?;
        }
        Ok(())
    });
    (written.is_ok() && begins).then(|| out.into_inner())
}

/// A part at the beginning of an archive.
pub struct FirstPart<'a> {
    /// Its name.
    pub name: &'a str,
    /// As many of its bytes as are there.
    pub bytes: &'a [u8],
    /// Whether that is all of them.
    pub is_whole: bool,
}

/// The parts at the beginning of an archive's bytes, by their own headers (APPNOTE.TXT, 4.3.7); ends with the last one whose
/// header is there, or before one that is compressed.
pub fn first_parts(mut start: &[u8]) -> impl Iterator<Item = FirstPart<'_>> {
    std::iter::from_fn(move || {
        let word = |at: usize| Some(usize::from(u16::from_le_bytes(start.get(at..at + 2)?.try_into().ok()?)));
        let name_end = HEADER + word(26)?;
        let data = name_end + word(28)?;
        let size = u32::from_le_bytes(start.get(18..22)?.try_into().ok()?) as usize;
        let name = std::str::from_utf8(start.get(HEADER..name_end)?).ok()?;
        // Flags and method: stored, its size in the header.
        let is_plain = start.starts_with(b"PK\x03\x04") && word(6)? & 8 == 0 && word(8)? == 0;
        let rest = start.get(data..).filter(|_| is_plain)?;
        let (bytes, left) = rest.split_at_checked(size).unwrap_or((rest, &[]));
        start = left;
        Some(FirstPart { name, bytes, is_whole: bytes.len() == size })
    })
}

/// An open archive. Its errors are texts that say what is wrong.
pub struct StoredZip<R> {
    zip: ZipArchive<R>,
    length: u64,
    /// Bytes that may still be read, at first twice the file's size: entries of a crafted archive may share their
    /// bytes.
    left: u64,
}

impl<R: Read + Seek> StoredZip<R> {
    /// Reads the list of parts.
    pub fn open(mut reader: R) -> Result<Self, String> {
        let length = reader.seek(io::SeekFrom::End(0)).map_err(|error| error.to_string())?;
        let zip = ZipArchive::new(reader).map_err(|error| error.to_string())?;
        Ok(Self { zip, length, left: 2 * length })
    }

    /// Bytes of the file.
    pub fn length(&self) -> u64 {
        self.length
    }

    /// Whether there is such a part.
    pub fn has(&self, part: &str) -> bool {
        self.zip.index_for_name(part).is_some()
    }

    /// Where the bytes of a part begin in the file, and their number; errors as for [`StoredZip::bytes`].
    pub fn place(&mut self, part: &str) -> Result<(u64, u64), String> {
        match self.zip.by_name(part) {
            Ok(entry) if entry.compression() == CompressionMethod::Stored => {
                let begin = entry.data_start().ok_or("cannot be found")?;
                let end = begin.checked_add(entry.size()).filter(|&end| end <= self.length);
                end.map(|_| (begin, entry.size())).ok_or_else(|| "is longer than the file".to_owned())
            }
            Err(ZipError::FileNotFound) => Err("is missing".to_owned()),
            Ok(_) => Err("is compressed, which no part of such a file is".to_owned()),
            Err(error) => Err(format!("cannot be read ({error})")),
        }
    }

    /// A part: `is missing` or `cannot be read (why)` otherwise. It is no larger than the file.
    pub fn bytes(&mut self, part: &str) -> Result<Vec<u8>, String> {
        let mut bytes = Vec::new();
        let left = &mut self.left;
        let outcome = self.zip.by_name(part).and_then(|mut entry| match entry.compression() {
            CompressionMethod::Stored => {
                *left = left.checked_sub(entry.size()).ok_or(ZipError::UnsupportedArchive("its parts overlap"))?;
                Ok(entry.read_to_end(&mut bytes)?)
            }
            _ => Err(ZipError::UnsupportedArchive("it is compressed, which no part of such a file is")),
        });
        match outcome {
            Ok(_) => Ok(bytes),
            Err(ZipError::FileNotFound) => Err("is missing".to_owned()),
            Err(error) => Err(format!("cannot be read ({error})")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Entries that share their bytes cannot make a small file a large one.
    #[test]
    fn no_more_is_read_than_the_file_holds_twice() {
        let mut out = Cursor::new(Vec::new());
        write(&mut out, |zip| {
            add(zip, "part.0", &[7; 10_000])?;
            (1..5).try_for_each(|copy| Ok(zip.shallow_copy_file("part.0", &format!("part.{copy}"))?))
        })
        .unwrap();
        let mut zip = StoredZip::open(out).unwrap();
        let read: Vec<_> = (0..5).map(|part| zip.bytes(&format!("part.{part}"))).collect();
        assert_eq!(read[0].as_ref().unwrap().len(), 10_000);
        assert!(read[4].is_err(), "{read:?}");
    }

    /// What is unpacked could be a thousand times as large.
    #[test]
    fn the_first_parts_end_before_a_compressed_one() {
        let mut out = Cursor::new(Vec::new());
        write(&mut out, |zip| {
            add(zip, "a", b"one")?;
            zip.start_file("b", SimpleFileOptions::default().compression_method(CompressionMethod::Deflated))?;
            zip.write_all(&[7; 100])?;
            add(zip, "c", b"three")
        })
        .unwrap();
        let bytes = out.into_inner();
        let parts: Vec<_> = first_parts(&bytes).map(|part| (part.name, part.bytes, part.is_whole)).collect();
        assert_eq!(parts, [("a", &b"one"[..], true)]);
        let cut: Vec<_> = first_parts(&bytes[..33]).map(|part| (part.bytes, part.is_whole)).collect();
        assert_eq!(cut, [(&b"on"[..], false)]);
        assert!(before(&bytes, "b").is_none() && before(&bytes, "a").is_some());
    }
}
