//! The readers as the property tests of the project have them.

#[path = "../../tests/bad_input_random/readers.rs"]
pub mod readers;
#[path = "../../tests/bad_input_random/seeds.rs"]
pub mod seeds;

/// Writes whole files into `corpus/TARGET/`, for the fuzzer to begin with.
pub fn write_seeds(target: &str) {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(target);
    std::fs::create_dir_all(&folder).expect("a folder for the seeds");
    for (at, seed) in seeds::of(target).iter().enumerate() {
        std::fs::write(folder.join(format!("seed-{at}")), seed).expect("a seed");
    }
}
