//! The residual network's weights on the host: names and shapes of the published state dict, initial values, files.

mod initial;
mod turned;

pub use initial::{initial, random};
pub use turned::turned;

use super::layers::{COLORS, CONFIDENCE, FINAL, LAYERS, Layer, MLP1, MLP2, OUTPUTS, WEIGHTS, WIDTHS};
use super::pth::read_pth;
use super::state_dict::StateDict;
use crate::files::{WriteError, write_atomically};
use crate::gpu::GpuError;
use safetensors::tensor::{Dtype, SafeTensorError, TensorView, serialize};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Name of the network's file beside a model.
pub const FILE_NAME: &str = "residual_network.safetensors";

/// Name of the published code's file.
pub const PUBLISHED_FILE_NAME: &str = "color_aggregation_network.pth";

/// Why the residual network could not be read, written or moved.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum NetworkError {
    /// The operating system refused to read the file.
    #[error("cannot read {}: {source}; check that the path names a file of network weights", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The file is no container of tensors.
    #[error("{} is not a usable file of network weights: {reason}; copy or export it again", path.display())]
    BadFile {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A tensor is not in the file.
    #[error("{} has no tensor `{tensor}`; is it the state dict of another network?", path.display())]
    MissingTensor {
        /// The file.
        path: PathBuf,
        /// Its name in the published state dict.
        tensor: String,
    },
    /// A tensor has another shape.
    #[error("{}: tensor `{tensor}` has the shape {found:?} where {expected:?} is needed", path.display())]
    Shape {
        /// The file.
        path: PathBuf,
        /// Name of the tensor.
        tensor: String,
        /// Its shape in this network.
        expected: Vec<usize>,
        /// Its shape in the file.
        found: Vec<usize>,
    },
    /// A tensor does not hold 32-bit floats.
    #[error("{}: tensor `{tensor}` holds {found} values where 32-bit floats are needed", path.display())]
    Type {
        /// The file.
        path: PathBuf,
        /// Name of the tensor.
        tensor: String,
        /// What it holds.
        found: String,
    },
    /// A weight is NaN or infinite.
    #[error("{place}: value {index} (counted from 0) of tensor `{tensor}` is {value}, which is not a finite number")]
    NotFinite {
        /// File, or the network in memory.
        place: String,
        /// Name of the tensor.
        tensor: String,
        /// Position in the tensor.
        index: usize,
        /// The value.
        value: f32,
    },
    /// Another number of weights.
    #[error("the residual network has {WEIGHTS} weights, not {found}")]
    Count {
        /// Weights given.
        found: usize,
    },
    /// The GPU failed.
    #[error("the residual network: {0}")]
    Gpu(#[from] GpuError),
    /// Writing failed.
    #[error(transparent)]
    Write(#[from] WriteError),
}

/// One tensor of a state dict and its place in the flat weights.
struct Named {
    name: String,
    shape: Vec<usize>,
    first: usize,
    layer: Layer,
    /// Not of the published network: zeros where a file has none.
    ours: bool,
}

impl Named {
    fn len(&self) -> usize {
        self.shape.iter().product()
    }
}

/// Name of the output that the published network does not have: the gate of the sources' mean difference.
const GATE: &str = "conv_decoder.gate";

/// Weight and bias of every layer, in the flat order.
fn tensors() -> Vec<Named> {
    let pair = |layer: &Layer| {
        // The last layer's outputs are two tensors: those of the published network and ours.
        let parts = match *layer {
            FINAL => vec![(FINAL.name, 0..COLORS, false), (GATE, COLORS..OUTPUTS, true)],
            l => vec![(l.name, 0..l.outputs, l == CONFIDENCE)],
        };
        let weight = parts.clone().into_iter().map(|(name, outputs, ours)| {
            let mut shape = vec![outputs.len(), layer.inputs];
            if ![MLP1, MLP2, CONFIDENCE].contains(layer) {
                shape.extend([layer.taps.isqrt(); 2]);
            }
            let first = layer.offset + outputs.start * layer.row();
            Named { name: format!("{name}.weight"), shape, first, layer: *layer, ours }
        });
        let bias = parts.into_iter().map(|(name, outputs, ours)| {
            let first = layer.bias() + outputs.start;
            Named { name: format!("{name}.bias"), shape: vec![outputs.len()], first, layer: *layer, ours }
        });
        weight.chain(bias).collect::<Vec<_>>()
    };
    LAYERS.iter().flat_map(pair).collect()
}

/// The values of a tensor, of which `find` gives those of a shape. A first layer may have one of these widths: its weights of the
/// numbers that come behind are zero.
fn read_tensor(
    tensor: &Named,
    widths: &[usize],
    mut find: impl FnMut(&str, &[usize]) -> Result<Option<Vec<f32>>, NetworkError>,
) -> Result<Option<Vec<f32>>, NetworkError> {
    let [outputs, inputs] = tensor.shape[..] else { return find(&tensor.name, &tensor.shape) };
    match find(&tensor.name, &tensor.shape) {
        Err(NetworkError::Shape { found, .. })
            if tensor.layer == MLP1 && widths.iter().any(|&width| found == [outputs, width]) =>
        {
            let row = |row: &[f32]| row.iter().copied().chain(std::iter::repeat(0.0)).take(inputs).collect::<Vec<_>>();
            let values = find(&tensor.name, &found)?;
            Ok(values.map(|values| values.chunks(found[1]).flat_map(row).collect()))
        }
        other => other,
    }
}

/// Flat weights from named tensors; `find` gives the values of a tensor of this shape, or None where there is none.
pub(super) fn assemble(
    path: &Path,
    mut find: impl FnMut(&str, &[usize]) -> Result<Option<Vec<f32>>, NetworkError>,
) -> Result<Vec<f32>, NetworkError> {
    let mut weights = Vec::with_capacity(WEIGHTS);
    for tensor in tensors() {
        match read_tensor(&tensor, WIDTHS, &mut find)? {
            Some(values) => weights.extend(values),
            None if tensor.ours => weights.resize(weights.len() + tensor.len(), 0.0),
            None => return Err(NetworkError::MissingTensor { path: path.to_owned(), tensor: tensor.name }),
        }
    }
    check(&path.display().to_string(), &weights)?;
    Ok(weights)
}

fn check(place: &str, weights: &[f32]) -> Result<(), NetworkError> {
    if weights.len() != WEIGHTS {
        return Err(NetworkError::Count { found: weights.len() });
    }
    let Some(at) = weights.iter().position(|w| !w.is_finite()) else {
        return Ok(());
    };
    let tensor = tensors().into_iter().rfind(|t| t.first <= at).expect("the first tensor starts at zero");
    let (place, value) = (place.to_owned(), weights[at]);
    Err(NetworkError::NotFinite { place, index: at - tensor.first, tensor: tensor.name, value })
}

/// Reads flat weights from a file of ours or, where its name ends in `.pth`, of the published code.
///
/// # Errors
/// As [`read`] and [`read_pth`].
pub fn load(path: &Path) -> Result<Vec<f32>, NetworkError> {
    if path.extension().is_some_and(|extension| extension == "pth") { read_pth(path) } else { read(path) }
}

/// Reads flat weights from a safetensors file; other tensors in it are passed over.
///
/// # Errors
/// A file that cannot be read or is damaged, a tensor that is missing or has another shape or type, values not finite.
pub fn read(path: &Path) -> Result<Vec<f32>, NetworkError> {
    let bytes = std::fs::read(path).map_err(|source| NetworkError::Read { path: path.to_owned(), source })?;
    from_bytes(&bytes, path)
}

/// Flat weights from the contents of a safetensors file; `path` is for messages.
///
/// # Errors
/// As [`read`].
pub fn from_bytes(bytes: &[u8], path: &Path) -> Result<Vec<f32>, NetworkError> {
    let file = StateDict::of_safetensors(bytes.into(), path)?;
    assemble(path, |name, shape| file.tensor(name, shape))
}

/// Writes flat weights as a safetensors file in one step, tensors named as in the published state dict.
///
/// # Errors
/// Another number of weights, values not finite, or a file that cannot be written.
pub fn write(path: &Path, weights: &[f32]) -> Result<(), NetworkError> {
    let file = to_bytes(weights)?;
    Ok(write_atomically(path, |w| w.write_all(&file))?)
}

/// The contents of a safetensors file of flat weights.
///
/// # Errors
/// Another number of weights, or values not finite.
pub fn to_bytes(weights: &[f32]) -> Result<Vec<u8>, NetworkError> {
    check("the residual network in memory", weights)?;
    let bytes: Vec<u8> = weights.iter().flat_map(|w| w.to_le_bytes()).collect();
    let bad = |e: SafeTensorError| NetworkError::BadFile { path: FILE_NAME.into(), reason: e.to_string() };
    let view = |t: &Named| TensorView::new(Dtype::F32, t.shape.clone(), &bytes[4 * t.first..4 * (t.first + t.len())]);
    let views = tensors().into_iter().map(|t| Ok((view(&t)?, t.name)));
    let views = views.map(|v| v.map(|(view, name)| (name, view))).collect::<Result<Vec<_>, _>>().map_err(bad)?;
    serialize(views, None).map_err(bad)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::residual::layers::{FEATURES, HIDDEN};

    fn edited(edit: impl FnOnce(&mut Vec<(String, Vec<usize>, Vec<f32>)>)) -> Result<Vec<f32>, NetworkError> {
        let weights = random(3);
        let mut named: Vec<_> = tensors()
            .into_iter()
            .map(|t| (t.name.clone(), t.shape.clone(), weights[t.first..t.first + t.len()].to_vec()))
            .collect();
        edit(&mut named);
        let bytes: Vec<Vec<u8>> =
            named.iter().map(|(_, _, v)| v.iter().flat_map(|w| w.to_le_bytes()).collect()).collect();
        let view = |shape: &Vec<usize>, bytes| TensorView::new(Dtype::F32, shape.clone(), bytes).unwrap();
        let views = named.iter().zip(&bytes).map(|((name, shape, _), bytes)| (name.as_str(), view(shape, bytes)));
        from_bytes(&serialize(views, None).unwrap(), Path::new("a.safetensors"))
    }

    #[test]
    fn tensors_cover_the_flat_weights() {
        let tensors = tensors();
        let ends = tensors.iter().map(|t| t.first + t.len());
        assert!(tensors.iter().skip(1).map(|t| t.first).eq(ends.take(tensors.len() - 1)));
        let shape = |name: &str| tensors.iter().find(|t| t.name == name).unwrap().shape.clone();
        assert_eq!(shape("per_view_mlp.0.weight"), [HIDDEN, FEATURES]);
        assert_eq!(shape("conv_decoder.enc1.0.weight"), [38, 38, 3, 3]);
        assert_eq!(shape("conv_decoder.final.weight"), [3, 38, 1, 1]);
        assert_eq!(shape("conv_decoder.final.bias"), [3]);
        assert_eq!(shape("per_view_confidence.weight"), [1, 33]);
    }

    #[test]
    fn files_come_back_as_they_were_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("below").join(FILE_NAME);
        write(&path, &random(1)).unwrap();
        assert_eq!(read(&path).unwrap(), random(1));
        let bytes = std::fs::read(&path).unwrap();
        write(&path, &random(1)).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), bytes, "the same file twice");
    }

    #[test]
    fn damaged_files_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(FILE_NAME);
        let text = |what: &str| {
            let text = read(&path).unwrap_err().to_string();
            assert!(text.contains(FILE_NAME), "{what}: {text}");
            text
        };
        assert!(text("absent").contains("cannot read"));
        write(&path, &random(1)).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        for length in [0, 5, 100, bytes.len() - 1] {
            std::fs::write(&path, &bytes[..length]).unwrap();
            assert!(text("truncated").contains("not a usable file"));
        }
        let mut longer = bytes.clone();
        longer.push(0);
        std::fs::write(&path, &longer).unwrap();
        text("with a byte more");
        let mut wild = bytes;
        wild[..8].fill(0xff);
        std::fs::write(&path, &wild).unwrap();
        text("wild header length");
    }

    #[test]
    fn wrong_tensors_are_named() {
        assert_eq!(edited(|_| ()).unwrap(), random(3));
        let text = edited(|t| t.retain(|(name, ..)| name != "conv_decoder.dec2.0.bias")).unwrap_err().to_string();
        assert!(text.contains("no tensor `conv_decoder.dec2.0.bias`") && text.contains("a.safetensors"), "{text}");
        let ours = |name: &str| name.starts_with("per_view_confidence") || name.starts_with(GATE);
        let published = edited(|t| t.retain(|(name, ..)| !ours(name))).unwrap();
        assert_eq!(published[..CONFIDENCE.offset], random(3)[..CONFIDENCE.offset]);
        assert_eq!(published[CONFIDENCE.offset..], [0.0; 34]);
        let gate = FINAL.offset + COLORS * FINAL.row()..FINAL.bias();
        assert!(published[gate].iter().chain(&published[FINAL.bias() + COLORS..FINAL.end()]).all(|w| *w == 0.0));
        let text = edited(|t| t[2].1 = vec![32, 16, 2]).unwrap_err().to_string();
        assert!(text.contains("`per_view_mlp.2.weight`") && text.contains("[32, 32]"), "{text}");
        let text = edited(|t| t[4].2[17] = f32::NAN).unwrap_err().to_string();
        assert!(text.contains("value 17") && text.contains("`conv_decoder.enc1.0.weight`"), "{text}");
    }

    #[test]
    fn a_network_of_fewer_inputs_is_read_with_zeros() {
        let tensor = tensors().into_iter().find(|tensor| tensor.layer == MLP1).unwrap();
        let narrow = FEATURES - 2;
        let find = |name: &str, shape: &[usize]| {
            if shape == [HIDDEN, narrow] {
                return Ok(Some((0..HIDDEN * narrow).map(|i| 1.0 + i as f32).collect()));
            }
            let (path, tensor, expected) = (PathBuf::new(), name.to_owned(), shape.to_vec());
            Err(NetworkError::Shape { path, tensor, expected, found: vec![HIDDEN, narrow] })
        };
        let read = read_tensor(&tensor, &[narrow, FEATURES], find).unwrap().unwrap();
        assert_eq!(read.len(), HIDDEN * FEATURES);
        for (i, value) in read.into_iter().enumerate() {
            let (output, input) = (i / FEATURES, i % FEATURES);
            assert_eq!(value, if input < narrow { (1 + output * narrow + input) as f32 } else { 0.0 });
        }
        let refused = read_tensor(&tensor, &[FEATURES], find);
        assert!(matches!(refused, Err(NetworkError::Shape { found, .. }) if found == [HIDDEN, narrow]));
    }

    #[test]
    fn only_whole_finite_networks_are_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(FILE_NAME);
        assert!(matches!(write(&path, &[0.0; 9]), Err(NetworkError::Count { found: 9 })));
        let mut weights = random(1);
        weights[FINAL.bias() + 2] = f32::INFINITY;
        let text = write(&path, &weights).unwrap_err().to_string();
        assert!(text.contains("value 2") && text.contains("`conv_decoder.final.bias`"), "{text}");
        assert!(!path.exists());
    }
}
