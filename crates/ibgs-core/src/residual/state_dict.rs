//! A file of named tensors: a PyTorch state dict or safetensors.

use super::weights::NetworkError;
use pytorch_reader::{DType, PytorchReader};
use safetensors::tensor::{Dtype, SafeTensorError, SafeTensors};
use std::borrow::Cow;
use std::fs::File;
use std::path::{Path, PathBuf};

/// Shape and values of a tensor.
pub type Values = (Vec<usize>, Vec<f32>);

/// An open file of named tensors; values are read when they are asked for.
pub struct StateDict<'a> {
    path: PathBuf,
    content: Content<'a>,
}

enum Content<'a> {
    /// Parsed, never executed.
    Torch(Box<PytorchReader>),
    /// The file, whose header is known to be sound.
    Safetensors(Cow<'a, [u8]>),
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
        File::open(path).map_err(|source| NetworkError::Read { path: path.to_owned(), source })?;
        let bad = |reason: String| NetworkError::BadFile { path: path.to_owned(), reason };
        let reader = PytorchReader::new(path).map_err(|e| bad(e.to_string()))?;
        Ok(Self { path: path.to_owned(), content: Content::Torch(Box::new(reader)) })
    }

    /// The contents of a safetensors file; `path` is for messages.
    pub(super) fn of_safetensors(bytes: Cow<'a, [u8]>, path: &Path) -> Result<Self, NetworkError> {
        let file = Self { path: path.to_owned(), content: Content::Safetensors(bytes) };
        if let Content::Safetensors(bytes) = &file.content {
            SafeTensors::deserialize(bytes).map_err(|e| file.bad(&e))?;
        }
        Ok(file)
    }

    /// The file's name.
    pub fn path(&self) -> &Path {
        &self.path
    }

    fn bad(&self, reason: &dyn ToString) -> NetworkError {
        NetworkError::BadFile { path: self.path.clone(), reason: reason.to_string() }
    }

    fn of_type(&self, name: &str, found: String) -> NetworkError {
        NetworkError::Type { path: self.path.clone(), tensor: name.to_owned(), found }
    }

    /// Shape and values of a tensor of 32-bit floats; none where the file has no such name.
    ///
    /// # Errors
    /// Damaged values, or values of another type.
    pub fn tensor(&self, name: &str) -> Result<Option<Values>, NetworkError> {
        match &self.content {
            Content::Torch(reader) => {
                let Some(tensor) = reader.get(name) else { return Ok(None) };
                if tensor.dtype() != DType::F32 {
                    return Err(self.of_type(name, format!("{:?}", tensor.dtype())));
                }
                // The reader has already turned the bytes into this machine's order.
                let bytes = tensor.read().map_err(|e| self.bad(&e))?;
                let values = bytes.as_chunks().0.iter().map(|b| f32::from_ne_bytes(*b)).collect();
                Ok(Some((tensor.shape().to_vec(), values)))
            }
            Content::Safetensors(bytes) => {
                let file = SafeTensors::deserialize(bytes).map_err(|e| self.bad(&e))?;
                let view = match file.tensor(name) {
                    Err(SafeTensorError::TensorNotFound(_)) => return Ok(None),
                    found => found.map_err(|e| self.bad(&e))?,
                };
                if view.dtype() != Dtype::F32 {
                    return Err(self.of_type(name, format!("{:?}", view.dtype())));
                }
                let values = view.data().as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
                Ok(Some((view.shape().to_vec(), values)))
            }
        }
    }
}
