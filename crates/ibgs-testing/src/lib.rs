//! What the tests of several crates share: scenes of every layout, real scenes beside the checkout, random models.
#![allow(missing_docs, reason = "for tests alone")]
#![forbid(unsafe_code)]

pub mod checkpoint_file;
pub mod scene_files;

use glam::DVec3;
use ibgs_data::dataset::{self, LoadOptions, Photo, Point};
use ibgs_data::scene::{Format, Gaussians, SceneError, read_gaussians_from, write_gaussians};
use ibgs_demo::DemoOptions;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::io::{Cursor, Write as _};
use std::path::{Path, PathBuf};

/// A file or folder of `../shared`, which is not in the repository; None where it is absent, and `test` is skipped.
pub fn shared(file: &str, test: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared").join(file);
    if path.exists() {
        return Some(path);
    }
    skipped(test, &format!("../shared/{file} is absent"));
    None
}

/// Says on stderr that `test` does not run, or only in part. The test passes all the same, and of a test that passes
/// libtest hides what the print macros write; it does not hide this.
pub fn skipped(test: &str, why: &str) {
    let line = format!("SKIPPED {test}: {why}\n");
    let _ = std::io::stderr().write_all(line.as_bytes());
}

/// A photo with every pixel the mean of those up to `radius` away.
pub fn blurred(photo: &Photo, radius: i32) -> Photo {
    let (width, height) = (photo.width as i32, photo.height as i32);
    let mut out = photo.clone();
    for (p, pixel) in (0..).zip(out.rgba.as_chunks_mut::<4>().0) {
        let around = |at: i32, end: i32| (at - radius).max(0)..(at + radius + 1).min(end);
        let (xs, ys) = (around(p % width, width), around(p / width, height));
        let count = (xs.len() * ys.len()) as u32;
        for (c, level) in pixel[..3].iter_mut().enumerate() {
            let at = |x: i32, y: i32| u32::from(photo.rgba[4 * (y * width + x) as usize + c]);
            let sum: u32 = ys.clone().flat_map(|y| xs.clone().map(move |x| (x, y))).map(|(x, y)| at(x, y)).sum();
            *level = (sum / count) as u8;
        }
    }
    out
}

/// Width and height of the photos of [`tiny_demo`].
pub const TINY: [u32; 2] = [32, 24];

/// The built-in scene in a size that a test can train.
pub fn tiny_demo() -> DemoOptions {
    let [width, height] = TINY;
    DemoOptions { width, height, views: 10, samples: 1, points: 300, seed: 0 }
}

/// Gaussians with values of either sign.
pub fn random_gaussians(n: usize, sh_degree: u32, seed: u64) -> Gaussians {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut value = move || rng.random_range(-4.0_f32..4.0);
    let mut g = Gaussians::with_capacity(n, sh_degree);
    for _ in 0..n {
        g.means.push([0; 3].map(|_| value()));
        g.rotations.push([0; 4].map(|_| value()));
        g.log_scales.push([0; 3].map(|_| value()));
        g.opacity_logits.push(value());
        g.normals.push([0; 3].map(|_| value()));
        g.offsets.push(value());
        g.sh.extend((0..3 * (sh_degree + 1).pow(2)).map(|_| value()));
    }
    g
}

/// Loading fails, and its message holds every fragment.
#[track_caller]
pub fn fails(scene: &Path, fragments: &[&str]) {
    fails_with(scene, &LoadOptions::default(), fragments);
}

/// The same with options.
#[track_caller]
pub fn fails_with(scene: &Path, options: &LoadOptions, fragments: &[&str]) {
    let message = match dataset::load(scene, options) {
        Ok(_) => panic!("loaded, but should fail with {fragments:?}"),
        Err(error) => error.to_string(),
    };
    for fragment in fragments {
        assert!(message.contains(fragment), "`{fragment}` is not in: {message}");
    }
    assert!(!message.contains('\n') && !message.contains("  "), "not one sentence: {message}");
}

/// Points around the origin.
pub fn random_points(n: usize, seed: u64) -> Vec<Point> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..n)
        .map(|_| Point { position: DVec3::from([0; 3].map(|_| rng.random_range(-2.0..2.0))), color: rng.random() })
        .collect()
}

/// Bytes of a PLY up to its data.
pub fn header_length(bytes: &[u8]) -> usize {
    let end = b"end_header\n";
    bytes.windows(end.len()).position(|w| w == end).unwrap() + end.len()
}

/// A model as a file.
pub fn bytes_of(g: &Gaussians, format: Format) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model");
    write_gaussians(&path, g, format).unwrap();
    std::fs::read(path).unwrap()
}

/// A model from a file of this name.
pub fn read(bytes: &[u8], name: &str) -> Result<Gaussians, SceneError> {
    read_gaussians_from(&mut Cursor::new(bytes), bytes.len() as u64, Path::new(name))
}
