//! The published code's `color_aggregation_network.pth`.

use super::state_dict::StateDict;
use super::weights::{NetworkError, assemble};
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::Path;
use zip::{CompressionMethod, ZipArchive};

/// Most bytes of pickle that a file of weights may have: some hundred for a tensor. Each may take a hundred in memory.
const MOST_PICKLE: u64 = 1 << 20;
/// A file of PyTorch before 1.6 begins with this many pickles: magic number, version, system, tensors, keys.
const LEGACY_PICKLES: usize = 5;
/// Where a TAR archive, the form before PyTorch 0.1.10, says so.
const TAR_MAGIC: std::ops::Range<usize> = 257..262;

/// Reads flat weights from a PyTorch state dict, as the published code saves it. Nothing in the file is executed: its
/// pickle is parsed, tensors and dictionaries are all that is understood.
///
/// # Errors
/// A file that cannot be read or is damaged, a tensor that is missing or has another shape or type, values not finite.
pub fn read_pth(path: &Path) -> Result<Vec<f32>, NetworkError> {
    let file = StateDict::open_pth(path)?;
    assemble(path, |name, shape| file.tensor(name, shape))
}

/// What makes a file's container unsuitable for reading, if anything: compressed parts and runs of zeros in TAR archives
/// unpack to any size.
pub(super) fn check_container(mut file: File) -> io::Result<Option<String>> {
    let length = file.metadata()?.len();
    let mut start = Vec::new();
    file.by_ref().take(MOST_PICKLE).read_to_end(&mut start)?;
    if start.starts_with(b"PK") {
        return Ok(ZipArchive::new(BufReader::new(file)).map_or_else(|e| Some(e.to_string()), check_zip));
    }
    if start.get(TAR_MAGIC) == Some(b"ustar") {
        return Ok(Some(
            "it is a TAR archive, as PyTorch wrote before 2017; save it again with a later one".to_owned(),
        ));
    }
    let mut rest = start.as_slice();
    for _ in 0..LEGACY_PICKLES {
        match after_pickle(rest) {
            Some(after) => rest = after,
            None if length > MOST_PICKLE => return Ok(Some(too_much_pickle())),
            // Whatever is wrong with it, it is small.
            None => break,
        }
    }
    Ok(None)
}

fn too_much_pickle() -> String {
    format!("it has more than {MOST_PICKLE} bytes besides the values, which no file of weights has")
}

fn check_zip(mut zip: ZipArchive<BufReader<File>>) -> Option<String> {
    (0..zip.len()).find_map(|index| {
        let entry = match zip.by_index_raw(index) {
            Err(error) => return Some(error.to_string()),
            Ok(entry) => entry,
        };
        let name = String::from_utf8_lossy(entry.name_raw());
        if entry.compression() != CompressionMethod::Stored {
            return Some(format!("its part `{}` is compressed, which PyTorch never does", name.escape_default()));
        }
        let large = entry.size().max(entry.compressed_size()) > MOST_PICKLE;
        (large && name.ends_with(".pkl")).then(too_much_pickle)
    })
}

/// What follows the pickle at the start, by the lengths of its opcodes; none where it does not end.
fn after_pickle(mut bytes: &[u8]) -> Option<&[u8]> {
    loop {
        let (&opcode, rest) = bytes.split_first()?;
        let (lines, fixed, counted) = match opcode {
            b'.' => return Some(rest),
            b'I' | b'L' | b'F' | b'S' | b'V' | b'P' | b'g' | b'p' => (1, 0, 0),
            b'c' | b'i' => (2, 0, 0),
            b'K' | b'q' | b'h' | 0x80 | 0x82 => (0, 1, 0),
            b'M' | 0x83 => (0, 2, 0),
            b'J' | b'r' | b'j' | 0x84 => (0, 4, 0),
            b'G' | 0x95 => (0, 8, 0),
            b'U' | b'C' | 0x8a | 0x8c => (0, 0, 1),
            b'T' | b'B' | b'X' | 0x8b => (0, 0, 4),
            0x8d | 0x8e | 0x96 => (0, 0, 8),
            _ => (0, 0, 0),
        };
        bytes = rest.get(fixed..)?;
        for _ in 0..lines {
            let end = bytes.iter().position(|byte| *byte == b'\n')?;
            bytes = &bytes[end + 1..];
        }
        let (count, after) = bytes.split_at_checked(counted)?;
        let count = count.iter().rev().fold(0_u64, |count, byte| count << 8 | u64::from(*byte));
        bytes = after.get(usize::try_from(count).ok()?..)?;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::residual::layers::{COLORS, FEATURES, FINAL, MLP1, WEIGHTS, WIDTHS};

    /// Made up, but written by PyTorch as the published code does.
    const PUBLISHED: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/color_aggregation_network.pth");

    #[test]
    fn published_network_loads() {
        let weights = read_pth(Path::new(PUBLISHED)).unwrap();
        assert_eq!(weights.len(), WEIGHTS);
        let gate = FINAL.offset + COLORS * FINAL.row()..FINAL.bias();
        let is_input = |i: usize| i < MLP1.bias() && i % FEATURES >= WIDTHS[0];
        let is_ours = |i: usize| is_input(i) || gate.contains(&i) || i >= FINAL.bias() + COLORS;
        let (ours, published): (Vec<_>, Vec<_>) = weights.into_iter().enumerate().partition(|(i, _)| is_ours(*i));
        assert_eq!(published.len(), 66_095);
        for (i, (_, weight)) in (0_u64..).zip(published) {
            assert_eq!(weight, ((i * (i + 856) % 1009) as f32 - 504.0) / 4096.0, "weight {i}");
        }
        assert!(ours.iter().all(|(_, weight)| *weight == 0.0), "the published network has none");
    }

    /// `posix.system("mkdir FOLDER")` as a pickle: any Python would make the folder.
    #[test]
    fn calls_in_a_pickle_are_not_made() {
        let folder = tempfile::tempdir().unwrap();
        let (path, made) = (folder.path().join("network.pth"), folder.path().join("made"));
        let call = format!("cposix\nsystem\n(S'mkdir {}'\ntR.", made.display());
        std::fs::write(&path, call).unwrap();
        read_pth(&path).unwrap_err();
        assert!(!made.exists());
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
        let published = std::fs::read(PUBLISHED).unwrap();
        for length in [100, published.len() / 2, published.len() - 10] {
            std::fs::write(&path, &published[..length]).unwrap();
            text("truncated");
        }
    }
}
