//! The buffers of glTF files: the binary chunk, data within the description, or files beside it.

use crate::dataset::names;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::Deserialize;
use std::borrow::Cow;
use std::cell::OnceCell;
use std::path::{Path, PathBuf};

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer {
    uri: Option<String>,
    byte_length: usize,
}

/// Buffers, each read when it is first needed.
pub(super) struct Buffers<'a> {
    all: Vec<Buffer>,
    loaded: Vec<OnceCell<Result<Cow<'a, [u8]>, String>>>,
    binary: &'a [u8],
    folder: PathBuf,
}

impl<'a> Buffers<'a> {
    /// Of a file at `path` with this binary chunk.
    pub(super) fn new(all: Vec<Buffer>, binary: &'a [u8], path: &Path) -> Self {
        let loaded = all.iter().map(|_| OnceCell::new()).collect();
        Self { all, loaded, binary, folder: path.parent().unwrap_or(Path::new("")).to_owned() }
    }

    /// The bytes of a buffer.
    ///
    /// # Errors
    /// Why they are not there.
    pub(super) fn get(&self, index: usize) -> Result<&[u8], String> {
        let (Some(buffer), Some(loaded)) = (self.all.get(index), self.loaded.get(index)) else {
            return Err(format!("it has no buffer {index}"));
        };
        let bytes = loaded.get_or_init(|| self.load(index, buffer)).as_ref().map_err(String::clone)?;
        bytes.get(..buffer.byte_length).ok_or_else(|| {
            format!("its buffer {index} has {} bytes where {} are needed", bytes.len(), buffer.byte_length)
        })
    }

    /// How many bytes were read so far, with the binary chunk.
    pub(super) fn bytes(&self) -> usize {
        let loaded = self.loaded.iter().filter_map(|loaded| loaded.get()?.as_ref().ok());
        loaded.map(|bytes| if let Cow::Owned(bytes) = bytes { bytes.len() } else { 0 }).sum::<usize>()
            + self.binary.len()
    }

    fn load(&self, index: usize, buffer: &Buffer) -> Result<Cow<'a, [u8]>, String> {
        let Some(uri) = &buffer.uri else {
            return match index {
                0 => Ok(Cow::Borrowed(self.binary)),
                _ => Err(format!("its buffer {index} has no `uri`")),
            };
        };
        if let Some(data) = uri.strip_prefix("data:") {
            let text = data.split_once(";base64,").map(|(_, text)| text);
            let text = text.ok_or_else(|| format!("its buffer {index} holds data that are no base64"))?;
            let decoded = STANDARD.decode(text);
            return decoded.map(Cow::Owned).map_err(|error| format!("its buffer {index} is no base64 ({error})"));
        }
        let name = unescaped(uri);
        let inside = names::inside(&name, |_| false).filter(|_| !uri.contains("://"));
        let inside = inside.ok_or_else(|| format!("its buffer `{}` lies in no file beside it", uri.escape_debug()))?;
        let bytes = std::fs::read(self.folder.join(&inside.name));
        bytes.map(Cow::Owned).map_err(|error| format!("its buffer `{}` cannot be read ({error})", inside.name))
    }
}

/// A name with `%20` and the like as the characters that they stand for.
fn unescaped(uri: &str) -> String {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let Some((&first, behind)) = rest.split_first() {
        let code = behind.get(..2).and_then(|code| std::str::from_utf8(code).ok());
        let code = code.filter(|_| first == b'%').and_then(|code| u8::from_str_radix(code, 16).ok());
        bytes.push(code.unwrap_or(first));
        rest = if code.is_some() { &behind[2..] } else { behind };
    }
    String::from_utf8_lossy(&bytes).into_owned()
}
