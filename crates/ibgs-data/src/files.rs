//! Writing files so that a crash or a full disk never leaves a partial one behind, and reading TOML with line numbers.

use serde::de::DeserializeOwned;
use std::fs;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;
use thiserror::Error;

/// A file or folder could not be written; what was there before is untouched.
#[derive(Debug, Error)]
#[error("cannot write {}: {source}; {advice}", path.display())]
pub struct WriteError {
    /// The file or folder that was to be written.
    pub path: PathBuf,
    /// What the operating system said.
    pub source: io::Error,
    /// What the user can do about it.
    pub advice: &'static str,
}

impl WriteError {
    /// Wraps an error of the operating system with advice that fits its kind.
    pub fn new(path: &Path, source: io::Error) -> Self {
        let advice = match source.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
                "free some disk space or choose another folder, no partial file was left"
            }
            io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => "choose a folder you may write to",
            io::ErrorKind::NotADirectory | io::ErrorKind::AlreadyExists | io::ErrorKind::IsADirectory => {
                "a file stands where a folder is needed, or the reverse: choose another path"
            }
            _ => "check the path and the disk",
        };
        Self { path: path.to_owned(), source, advice }
    }
}

/// Windows programs begin text files with this mark.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// The contents of a text file without its byte order mark.
pub fn without_mark(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes)
}

/// Whether two paths exist and lead to the same file or folder.
pub fn is_same(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

/// Writes `path` in one step: `write` fills a temporary file in the same folder, which is synchronised to the disk
/// and then renamed over `path`, with the permissions of an older file there. Missing parent folders are made.
///
/// # Errors
/// [`WriteError`] when any step fails; the temporary file is removed and an older file at `path` stays as it was.
pub fn write_atomically(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), WriteError> {
    replace(path, |out| write(out)).map_err(|source| WriteError::new(path, source))
}

/// [`write_atomically`] for formats that seek back to what they have written.
///
/// # Errors
/// As [`write_atomically`].
pub fn write_seekable_atomically(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&mut fs::File>) -> io::Result<()>,
) -> Result<(), WriteError> {
    replace(path, write).map_err(|source| WriteError::new(path, source))
}

/// Makes a folder and its parents; an existing one is fine.
///
/// # Errors
/// [`WriteError`] naming the folder.
pub fn create_folder(path: &Path) -> Result<(), WriteError> {
    fs::create_dir_all(path).map_err(|source| WriteError::new(path, source))
}

/// A text is not TOML, or has a field that is unknown or of the wrong kind.
#[derive(Debug, Error)]
#[error("line {line}: {reason}")]
pub struct TomlError {
    /// Line, from 1.
    pub line: usize,
    /// What is wrong.
    pub reason: String,
}

/// Reads a value from TOML.
///
/// # Errors
/// [`TomlError`] with the line and what is wrong there.
pub fn parse_toml<T: DeserializeOwned>(text: &str) -> Result<T, TomlError> {
    toml::from_str(text).map_err(|error| {
        let before = error.span().and_then(|span| text.get(..span.start)).unwrap_or_default();
        TomlError { line: before.matches('\n').count() + 1, reason: error.message().replace('\n', ", ") }
    })
}

fn replace(path: &Path, write: impl FnOnce(&mut BufWriter<&mut fs::File>) -> io::Result<()>) -> io::Result<()> {
    // The rename below would only notice after all the work that a folder is in the way.
    if path.is_dir() {
        return Err(io::ErrorKind::IsADirectory.into());
    }
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    fs::create_dir_all(folder)?;
    let mut temporary = temporary_file(folder, path)?;
    {
        let mut buffered = BufWriter::with_capacity(1 << 20, temporary.as_file_mut());
        let written = write(&mut buffered).and_then(|()| buffered.flush());
        if let Err(error) = written {
            // Dropping the buffer normally would try to write its rest once more.
            let _ = buffered.into_parts();
            return Err(error);
        }
    }
    temporary.as_file().sync_all()?;
    temporary.persist(path).map_err(|error| error.error)?;
    // Without this the rename itself may be lost in a power cut. Folders cannot be opened as files everywhere.
    #[cfg(unix)]
    fs::File::open(folder)?.sync_all()?;
    Ok(())
}

/// Temporary files are private by default; ours become the result, so the user's umask decides, and an older file at
/// `path` hands its permissions on.
#[cfg(unix)]
fn temporary_file(folder: &Path, path: &Path) -> io::Result<NamedTempFile> {
    use std::os::unix::fs::PermissionsExt;
    let older = fs::metadata(path).ok().map(|older| older.permissions());
    let wanted = older.clone().unwrap_or(fs::Permissions::from_mode(0o666));
    let file = builder().permissions(wanted).tempfile_in(folder)?;
    if let Some(older) = older {
        file.as_file().set_permissions(older)?;
    }
    Ok(file)
}

#[cfg(not(unix))]
fn temporary_file(folder: &Path, _path: &Path) -> io::Result<NamedTempFile> {
    builder().tempfile_in(folder)
}

/// Beginning and end of the names of temporary files.
const TEMPORARY: [&str; 2] = [".ibgs-", ".tmp"];

fn builder() -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(TEMPORARY[0]).suffix(TEMPORARY[1]);
    builder
}

/// Temporary files in a folder: what was being written when a process was killed, or is being written now.
pub fn leftovers(folder: &Path) -> Vec<PathBuf> {
    let is_temporary = |name: &str| name.starts_with(TEMPORARY[0]) && name.ends_with(TEMPORARY[1]);
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.filter(|entry| entry.file_name().to_str().is_some_and(is_temporary)).map(|entry| entry.path()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn failed_write_keeps_the_old_file_and_leaves_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        write_atomically(&path, |w| w.write_all(b"old")).unwrap();
        let error = write_atomically(&path, |w| {
            w.write_all(&[0; 4 << 20])?;
            Err(io::ErrorKind::StorageFull.into())
        })
        .unwrap_err();
        let text = error.to_string();
        assert!(text.contains("a.bin") && text.contains("free some disk space"), "{text}");
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn folders_in_the_way_are_named() {
        let folder = tempfile::tempdir().unwrap();
        assert!(write_atomically(folder.path(), |_| Ok(())).is_err());
        let file = folder.path().join("file");
        write_atomically(&file, |w| w.write_all(b"x")).unwrap();
        let text = write_atomically(&file.join("below"), |_| Ok(())).unwrap_err().to_string();
        assert!(text.contains("choose another path"), "{text}");
    }

    #[cfg(unix)]
    #[test]
    fn result_has_the_permissions_of_any_other_file() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let ours = folder.path().join("ours");
        let plain = folder.path().join("plain");
        write_atomically(&ours, |w| w.write_all(b"x")).unwrap();
        fs::write(&plain, b"x").unwrap();
        let mode = |p: &Path| fs::metadata(p).unwrap().permissions().mode();
        assert_eq!(mode(&ours), mode(&plain));
        for bits in [0o600, 0o664, 0o640] {
            fs::set_permissions(&ours, fs::Permissions::from_mode(bits)).unwrap();
            write_atomically(&ours, |w| w.write_all(b"y")).unwrap();
            assert_eq!(mode(&ours) & 0o777, bits);
            assert_eq!(fs::read(&ours).unwrap(), b"y");
        }
    }
}
