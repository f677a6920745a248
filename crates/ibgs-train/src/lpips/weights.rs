//! The weights of LPIPS on the host, from the files of other programs.

use ibgs_core::gpu::GpuError;
use ibgs_core::residual::NetworkError;
use ibgs_core::residual::state_dict::StateDict;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Blocks of VGG16, each but the first after halving the size.
pub(super) const BLOCKS: usize = 5;

/// Numbers of VGG16's layers in the published state dicts, with the outputs of each block's layers.
const TRUNK: [(usize, &[usize]); BLOCKS] =
    [(64, &[0, 2]), (128, &[5, 7]), (256, &[10, 12, 14]), (512, &[17, 19, 21]), (512, &[24, 26, 28])];

/// Why LPIPS cannot be computed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LpipsError {
    /// A file of weights cannot be used.
    #[error(transparent)]
    File(#[from] NetworkError),
    /// A tensor is in none of the files.
    #[error(
        "no tensor `{tensor}` in {files}; give the state dict of LPIPS(net='vgg'), or torchvision's vgg16 and the vgg.pth of the `lpips` package"
    )]
    Missing {
        /// Its name, or its names.
        tensor: String,
        /// The files.
        files: String,
    },
    /// Nothing is left of so small an image in the last block.
    #[error("LPIPS needs images of at least 16 x 16 pixels, not {width} x {height}")]
    TooSmall {
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
    },
    /// Not even a few rows of the image fit.
    #[error(
        "LPIPS of an image {width} pixels wide needs {bytes} bytes in one buffer, more than this device binds at once ({limit})"
    )]
    TooWide {
        /// Width in pixels.
        width: usize,
        /// Bytes of the smallest part.
        bytes: u64,
        /// Bytes at most.
        limit: u64,
    },
    /// The device failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

/// One 3 x 3 convolution.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Layer {
    pub inputs: usize,
    pub outputs: usize,
    /// `[outputs, inputs, 3, 3]`.
    pub weight: Vec<f32>,
    /// `[outputs]`.
    pub bias: Vec<f32>,
}

/// VGG16's convolutions and the weights of their channels.
#[derive(Clone, Debug, PartialEq)]
pub struct LpipsWeights {
    pub(super) blocks: Vec<Vec<Layer>>,
    pub(super) linear: Vec<Vec<f32>>,
}

impl LpipsWeights {
    /// Reads them from the state dict of the `lpips` package's `LPIPS(net='vgg')`, or from two files: torchvision's
    /// vgg16 and the package's `vgg.pth`, in any order. Files are PyTorch's (`.pth`, `.pt`) or safetensors; other
    /// tensors in them are passed over.
    ///
    /// # Errors
    /// A file that cannot be read or is damaged, a tensor that is missing or has another shape or type, values that are
    /// not finite.
    pub fn load(paths: &[PathBuf]) -> Result<Self, LpipsError> {
        let files = Files(paths.iter().map(|path| StateDict::open(path)).collect::<Result<_, _>>()?);
        let mut blocks = Vec::with_capacity(BLOCKS);
        let mut linear = Vec::with_capacity(BLOCKS);
        let mut inputs = 3;
        for (block, (outputs, numbers)) in TRUNK.into_iter().enumerate() {
            let mut layers = Vec::new();
            for number in numbers {
                let names = |kind: &str| {
                    [format!("net.slice{}.{number}.{kind}", block + 1), format!("features.{number}.{kind}")]
                };
                let weight = files.find(&names("weight"), &[outputs, inputs, 3, 3])?;
                let bias = files.find(&names("bias"), &[outputs])?;
                layers.push(Layer { inputs, outputs, weight, bias });
                inputs = outputs;
            }
            blocks.push(layers);
            linear.push(files.find(&[format!("lin{block}.model.1.weight")], &[1, outputs, 1, 1])?);
        }
        Ok(Self { blocks, linear })
    }
}

/// The open files.
struct Files(Vec<StateDict<'static>>);

impl Files {
    /// Values of a tensor that has one of the names.
    fn find(&self, names: &[String], shape: &[usize]) -> Result<Vec<f32>, LpipsError> {
        for (file, name) in self.0.iter().flat_map(|file| names.iter().map(move |name| (file, name))) {
            if let Some(values) = file.tensor(name, shape)? {
                return finite(file.path(), name, values);
            }
        }
        let files: Vec<String> = self.0.iter().map(|file| file.path().display().to_string()).collect();
        Err(LpipsError::Missing { tensor: names.join("` or `"), files: files.join(" and ") })
    }
}

fn finite(path: &Path, name: &str, values: Vec<f32>) -> Result<Vec<f32>, LpipsError> {
    match values.iter().position(|value| !value.is_finite()) {
        None => Ok(values),
        Some(index) => {
            let (place, tensor, value) = (path.display().to_string(), name.to_owned(), values[index]);
            Err(NetworkError::NotFinite { place, tensor, index, value }.into())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_follow_one_another() {
        let numbers: Vec<usize> = TRUNK.iter().flat_map(|(_, numbers)| numbers.iter().copied()).collect();
        // Every convolution is followed by a ReLU, every block by a pooling.
        assert_eq!(numbers, [0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28]);
    }

    #[test]
    fn rubbish_is_answered_with_its_name() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.pth", "a.pt", "a.safetensors", "a"] {
            let path = folder.path().join(name);
            let text = || LpipsWeights::load(std::slice::from_ref(&path)).unwrap_err().to_string();
            assert!(text().contains("cannot read") && text().contains(name), "{}", text());
            std::fs::write(&path, b"no weights at all").unwrap();
            assert!(text().contains("is not a usable file") && text().contains(name), "{}", text());
        }
    }
}
