//! The readers as the property tests of the project have them. The environment variable `READER` names the one to fuzz.

use readers::Reader;
use std::path::Path;
use std::sync::LazyLock;

#[path = "../../tests/bad_input_random/readers.rs"]
pub mod readers;
#[path = "../../tests/bad_input_random/seeds.rs"]
pub mod seeds;

static READER: LazyLock<(&str, Reader)> = LazyLock::new(|| {
    let wanted = std::env::var("READER").unwrap_or_default();
    let names: Vec<&str> = readers::all().into_iter().map(|(name, _)| name).collect();
    let found = readers::all().into_iter().find(|(name, _)| *name == wanted);
    found.unwrap_or_else(|| panic!("READER must be one of {}", names.join(", ")))
});

/// Writes whole files into `corpus/READER/`, for the fuzzer to begin with.
pub fn write_seeds() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(READER.0);
    std::fs::create_dir_all(&folder).expect("a folder for the seeds");
    for (at, seed) in seeds::of(READER.0).iter().enumerate() {
        std::fs::write(folder.join(format!("seed-{at}")), seed).expect("a seed");
    }
}

/// Reads what the fuzzer made.
pub fn read(bytes: &[u8]) {
    (READER.1)(bytes);
}
