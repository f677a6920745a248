//! Files made to harm: what the program answers, and how much memory it takes for that.

use super::{Outcome, Sandbox};
use crate::bad_input_random::mutate::{damaged, damages};
use crate::bad_input_random::{attacks, seeds};
use ibgs_testing::scene_files::{Model, write_file, zip_of};
use proptest::strategy::{Strategy, ValueTree};
use proptest::test_runner::{Config, RngSeed, TestRunner};

/// A name in a file may hold anything; what is told of it stays one line that moves no cursor.
#[test]
fn names_do_not_write_on_the_terminal() {
    let sandbox = Sandbox::new();
    let mut model = Model::small(2);
    model.write_photos(&sandbox.path("scene"));
    model.images[0].name = "a\u{1b}[2J\n0.png".to_owned();
    model.write_binary(&sandbox.path("scene"));
    let sentence = "image name `a\\u{1b}[2J 0.png` is empty, or absolute without a photo of that name in the scene, or";
    sandbox.fails("train scene -m out", &["images.bin", sentence]);
    assert!(sandbox.succeeds("info scene").stdout.contains("a?[2J?0.png"));
    model.images[0].name = format!("../{}", "long".repeat(10_000));
    model.write_binary(&sandbox.path("scene"));
    let outcome = sandbox.run("train scene -m out");
    outcome.assert_failure(1, &["images.bin"]);
    let length = outcome.error_lines()[0].len();
    assert!(length > 1000 && length < 2100, "{length} characters");
}

#[test]
fn damaged_suites() {
    let sandbox = Sandbox::new();
    let whole = "title = \"Two\"\noptions = { iterations = 4, data = { resolution = \"2\" } }\n[[scenes]]\n\
                 name = \"demo\"\ndemo = true\n[[runs]]\nname = \"base\"\noptions = { method = \"3dgs\" }\n\
                 [[published]]\nmethod = \"other\"\non = \"demo\"\npsnr = 9.5\n";
    sandbox.write("a.toml", whole);
    sandbox.succeeds("suite a.toml --summary-only");
    let cases = std::env::var("PROPTEST_CASES").ok().and_then(|cases| cases.parse().ok()).unwrap_or(40_u32);
    let mut runner = TestRunner::new(Config { rng_seed: RngSeed::Fixed(7), ..Config::default() });
    let mut refused = 0;
    for _ in 0..cases.min(1000) {
        let damages = damages().new_tree(&mut runner).unwrap().current();
        sandbox.write("a.toml", damaged(whole.as_bytes(), 0, &damages));
        let outcome = sandbox.run("suite a.toml --summary-only");
        match outcome.code {
            Some(0) => outcome.assert_success(),
            _ => {
                refused += 1;
                outcome.assert_failure(1, &["a.toml"]);
            }
        }
    }
    assert!(refused > cases.min(1000) / 4, "{refused} of {cases} were refused");
    let outside = std::fs::read_dir(sandbox.path("")).unwrap().count();
    assert!(outside <= 2, "more than a.toml and output");
}

/// The program with a limit on its address space, in KiB.
#[cfg(target_os = "linux")]
fn bounded(sandbox: &Sandbox, kib: u32, arguments: &str) -> Outcome {
    let mut command = std::process::Command::new("sh");
    let run = format!("ulimit -v {kib}; exec {} {arguments}", env!("CARGO_BIN_EXE_ibgs"));
    Outcome::of(arguments, command.args(["-c", &run]).current_dir(sandbox.path("")))
}

#[test]
#[cfg(target_os = "linux")]
fn sizes_that_lie_take_no_memory() {
    const KIB: u32 = 1 << 20;
    let sandbox = Sandbox::new();
    let model = Model::small(2);
    model.write_photos(&sandbox.path("scene"));
    model.write_binary(&sandbox.path("scene"));
    bounded(&sandbox, KIB, "info scene").assert_success();
    for stem in ["cameras", "images", "points3D"] {
        model.write_binary(&sandbox.path("scene"));
        let path = sandbox.path(&format!("scene/sparse/0/{stem}.bin"));
        let mut bytes = std::fs::read(&path).unwrap();
        bytes[..8].copy_from_slice(&(1_u64 << 60).to_le_bytes());
        write_file(&path, bytes);
        bounded(&sandbox, KIB, "info scene").assert_failure(1, &["claims 1152921504606846976", "room for at most"]);
    }
    let ply = String::from_utf8_lossy(&seeds::of("ply")[2]).replace("vertex 2", "vertex 1152921504606846976");
    sandbox.write("a.ply", ply);
    bounded(&sandbox, KIB, "info a.ply").assert_failure(1, &["a.ply", "1152921504606846976"]);
    let zeros = vec![0; 1 << 30];
    sandbox.write("bomb.zip", zip_of(&[("images/zeros.png", &zeros)]));
    bounded(&sandbox, KIB, "info bomb.zip").assert_failure(1, &["bomb.zip", "it unpacks to more than"]);
    // The size of the photo is in its header alone.
    model.write_binary(&sandbox.path("scene"));
    sandbox.write("scene/images/a0.png", attacks::png_header(100_000, 100_000));
    let outcome = bounded(&sandbox, 4 * KIB, "train scene -m out");
    outcome.assert_failure(1, &["a0.png does not decode: its header promises 100000 x 100000 pixels"]);
}
