//! The published code's `color_aggregation_network.pth`.

use super::state_dict::StateDict;
use super::weights::{NetworkError, assemble};
use std::path::Path;

/// Reads flat weights from a PyTorch state dict, as the published code saves it. Nothing in the file is executed: its
/// pickle is parsed, tensors and dictionaries are all that is understood.
///
/// # Errors
/// A file that cannot be read or is damaged, a tensor that is missing or has another shape or type, values not finite.
pub fn read_pth(path: &Path) -> Result<Vec<f32>, NetworkError> {
    let file = StateDict::open_pth(path)?;
    assemble(path, |name| file.tensor(name))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::residual::layers::{ENC1, WEIGHTS};

    const PUBLISHED: &str =
        concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/golden/color_aggregation_network.pth");

    #[test]
    fn published_network_loads() {
        let path = Path::new(PUBLISHED);
        if !path.is_file() {
            eprintln!("SKIPPED published_network_loads: ../shared/golden absent");
            return;
        }
        let weights = read_pth(path).unwrap();
        assert_eq!(weights.len(), WEIGHTS);
        let mean = weights.iter().map(|w| w.abs()).sum::<f32>() / WEIGHTS as f32;
        assert!(mean > 1e-3 && mean < 1.0, "mean absolute weight {mean}");
        println!("mean absolute weight {mean}, first of enc1 {}", weights[ENC1.offset]);
    }

    #[test]
    fn damaged_files_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("network.pth");
        let text = |what: &str| {
            let text = read_pth(&path).unwrap_err().to_string();
            assert!(text.contains("network.pth"), "{what}: {text}");
            text
        };
        assert!(text("absent").contains("cannot read"));
        for bytes in [&b""[..], b"PK\x03\x04", b"not a checkpoint at all", &[0x80, 2, b'}', b'.']] {
            std::fs::write(&path, bytes).unwrap();
            text("rubbish");
        }
        let Ok(published) = std::fs::read(PUBLISHED) else {
            eprintln!("SKIPPED the rest of damaged_files_are_named: ../shared/golden absent");
            return;
        };
        for length in [100, published.len() / 2, published.len() - 10] {
            std::fs::write(&path, &published[..length]).unwrap();
            text("truncated");
        }
    }
}
