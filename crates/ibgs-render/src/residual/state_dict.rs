//! A file of named tensors: a PyTorch state dict or safetensors.

use super::pth;
use super::weights::NetworkError;
use pytorch_reader::{DType, PytorchReader};
use safetensors::tensor::{Dtype, Metadata};
use std::borrow::Cow;
use std::fs::File;
use std::path::{Path, PathBuf};

/// An open file of named tensors; values are read when they are asked for.
pub struct StateDict<'a> {
    path: PathBuf,
    content: Content<'a>,
}

enum Content<'a> {
    /// Parsed, never executed.
    Torch(Box<PytorchReader>),
    /// The file, its header, and where the values begin.
    Safetensors { bytes: Cow<'a, [u8]>, header: Metadata, data: usize },
}

impl<'a> StateDict<'a> {
    /// Opens a PyTorch file where the name ends in `.pth` or `.pt`, a safetensors file otherwise.
    ///
    /// # Errors
    /// A file that cannot be read, or is none of these.
    pub fn open(path: &Path) -> Result<Self, NetworkError> {
        if path.extension().is_some_and(|extension| extension == "pth" || extension == "pt") {
            return Self::open_pth(path);
        }
        let bytes = std::fs::read(path).map_err(|source| NetworkError::Read { path: path.to_owned(), source })?;
        Self::of_safetensors(bytes.into(), path)
    }

    /// Opens a PyTorch file.
    pub(super) fn open_pth(path: &Path) -> Result<Self, NetworkError> {
        let unreadable = |source| NetworkError::Read { path: path.to_owned(), source };
        let bad = |reason: String| NetworkError::BadFile { path: path.to_owned(), reason };
        let file = File::open(path).map_err(unreadable)?;
        pth::check_container(file).map_err(unreadable)?.map_or(Ok(()), |problem| Err(bad(problem)))?;
        let reader = PytorchReader::new(path).map_err(|e| bad(e.to_string()))?;
        Ok(Self { path: path.to_owned(), content: Content::Torch(Box::new(reader)) })
    }

    /// The contents of a safetensors file; `path` is for messages.
    pub(super) fn of_safetensors(bytes: Cow<'a, [u8]>, path: &Path) -> Result<Self, NetworkError> {
        let (header, data) =
            safetensors_header(&bytes).map_err(|reason| NetworkError::BadFile { path: path.to_owned(), reason })?;
        Ok(Self { path: path.to_owned(), content: Content::Safetensors { bytes, header, data } })
    }

    /// The file's name.
    pub fn path(&self) -> &Path {
        &self.path
    }

    fn bad(&self, reason: &dyn ToString) -> NetworkError {
        NetworkError::BadFile { path: self.path.clone(), reason: reason.to_string() }
    }

    fn check_shape(&self, name: &str, expected: &[usize], found: &[usize]) -> Result<(), NetworkError> {
        if found == expected {
            return Ok(());
        }
        let (path, tensor) = (self.path.clone(), name.to_owned());
        Err(NetworkError::Shape { path, tensor, expected: expected.to_vec(), found: found.to_vec() })
    }

    fn of_type(&self, name: &str, found: String) -> NetworkError {
        NetworkError::Type { path: self.path.clone(), tensor: name.to_owned(), found }
    }

    /// The values of a tensor of 32-bit floats of this shape; none where the file has no such name.
    ///
    /// # Errors
    /// Another shape, damaged values, or values of another type.
    pub fn tensor(&self, name: &str, shape: &[usize]) -> Result<Option<Vec<f32>>, NetworkError> {
        match &self.content {
            Content::Torch(reader) => {
                let Some(tensor) = reader.get(name) else { return Ok(None) };
                if tensor.dtype() != DType::F32 {
                    return Err(self.of_type(name, format!("{:?}", tensor.dtype())));
                }
                // Before anything is read: a tensor that repeats its values can claim to be larger than its file.
                self.check_shape(name, shape, tensor.shape())?;
                // The reader has already turned the bytes into this machine's order.
                let bytes = tensor.read().map_err(|e| self.bad(&e))?;
                Ok(Some(bytes.as_chunks().0.iter().map(|b| f32::from_ne_bytes(*b)).collect()))
            }
            Content::Safetensors { bytes, header, data } => {
                let Some(tensor) = header.info(name) else { return Ok(None) };
                if tensor.dtype != Dtype::F32 {
                    return Err(self.of_type(name, format!("{:?}", tensor.dtype)));
                }
                self.check_shape(name, shape, &tensor.shape)?;
                let (begin, end) = tensor.data_offsets;
                let values = bytes.get(*data..).and_then(|data| data.get(begin..end));
                let values = values.ok_or_else(|| self.bad(&format!("`{name}` lies outside of it")))?;
                Ok(Some(values.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect()))
            }
        }
    }
}

/// The header of a safetensors file and where its values begin: after the header's length and the header. The header's
/// offsets cover the values without a gap.
fn safetensors_header(bytes: &[u8]) -> Result<(Metadata, usize), String> {
    const ENDS_EARLY: &str = "it ends inside its header";
    let length = bytes.first_chunk().map(|length| u64::from_le_bytes(*length)).ok_or(ENDS_EARLY)?;
    let begin = size_of::<u64>();
    let end = usize::try_from(length).ok().and_then(|length| length.checked_add(begin)).ok_or(ENDS_EARLY)?;
    let header = bytes.get(begin..end).ok_or(ENDS_EARLY)?;
    let header: Metadata = serde_json::from_slice(header).map_err(|error| format!("its header: {error}"))?;
    let (promised, found) = (header.data_len(), bytes.len() - end);
    if promised != found {
        return Err(format!("its header promises {promised} bytes of values, it has {found}"));
    }
    Ok((header, end))
}
