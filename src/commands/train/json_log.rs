//! The file of `--log-json`.

use anyhow::{Context, Result, bail};
use ibgs_core::files;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::Path;

/// What becomes of a file that is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Before {
    /// It stays, and so there can be no log.
    Kept,
    /// It is replaced.
    Replaced,
    /// The log continues it: its training is resumed.
    Continued,
}

impl Before {
    /// For a training that is resumed, or may overwrite.
    pub fn of(resumes: bool, overwrites: bool) -> Self {
        match (resumes, overwrites) {
            (true, _) => Self::Continued,
            (false, true) => Self::Replaced,
            (false, false) => Self::Kept,
        }
    }
}

/// Refuses a file that cannot become the log; nothing is written.
pub fn check(path: &Path, before: Before) -> Result<()> {
    if path.is_dir() {
        bail!("the log cannot replace the folder {}; give `--log-json` a file", path.display());
    }
    if path.is_file() && before == Before::Kept {
        bail!("{} is there already; choose another file for `--log-json`, or allow `--overwrite`", path.display());
    }
    Ok(())
}

/// Opens the log for more lines.
pub fn open(path: &Path, before: Before) -> Result<File> {
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        files::create_folder(folder)?;
    }
    let unusable = || format!("cannot write {}; choose another file for `--log-json`", path.display());
    if before != Before::Continued {
        return File::create(path).with_context(unusable);
    }
    let mut file = File::options().read(true).append(true).create(true).open(path).with_context(unusable)?;
    end_line(&mut file).with_context(unusable)?;
    Ok(file)
}

/// Ends the line that a killed training may have left half written.
fn end_line(file: &mut File) -> std::io::Result<()> {
    if file.seek(SeekFrom::End(0))? == 0 {
        return Ok(());
    }
    file.seek(SeekFrom::End(-1))?;
    let mut last = [0];
    file.read_exact(&mut last)?;
    if last == *b"\n" { Ok(()) } else { file.write_all(b"\n") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn a_file_is_kept_replaced_or_continued() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("below/log.jsonl");
        check(&path, Before::Kept).unwrap();
        open(&path, Before::Kept).unwrap().write_all(b"{}\n{\"half").unwrap();
        assert!(check(&path, Before::Kept).unwrap_err().to_string().contains("`--overwrite`"));
        for expected in ["{}\n{\"half\n{}\n", "{}\n{\"half\n{}\n{}\n"] {
            check(&path, Before::Continued).unwrap();
            open(&path, Before::Continued).unwrap().write_all(b"{}\n").unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), expected);
        }
        check(&path, Before::Replaced).unwrap();
        drop(open(&path, Before::Replaced).unwrap());
        assert_eq!(fs::read(&path).unwrap(), b"");
        assert!(check(folder.path(), Before::Continued).unwrap_err().to_string().contains("--log-json"));
    }
}
