//! LPIPS against its double-precision twin, through files of weights as users have them.

use crate::lpips_network::{network, tensors, write, write_network};
use ibgs_core::dataset::Photo;
use ibgs_core::render::Rendered;
use ibgs_reference::gpu::gpu;
use ibgs_reference::lpips::distance;
use ibgs_train::lpips::{BAND_BYTES, InputRange, Lpips, LpipsError, LpipsWeights};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::path::PathBuf;

fn photo(seed: u64, width: u32, height: u32) -> Photo {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let rgba = (0..width * height).flat_map(|_| [rng.random(), rng.random(), rng.random(), 255]).collect();
    Photo { width, height, rgba }
}

fn rendered(photo: &Photo) -> Rendered {
    let rgb = photo.rgba.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).map(|v| f32::from(v) / 255.0).collect();
    Rendered { width: photo.width, height: photo.height, rgb }
}

fn load(paths: &[PathBuf]) -> LpipsWeights {
    LpipsWeights::load(paths).unwrap()
}

#[test]
fn distances_agree_with_the_twin_in_both_ranges() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lpips.safetensors");
    write_network(&path);
    let weights = load(std::slice::from_ref(&path));
    // Odd sizes, so that poolings leave rows and columns out.
    let (width, height) = (35, 21);
    let (a, mut b) = (photo(1, width, height), photo(2, width, height));
    // Masked pixels take the image's value, whatever the photo has there.
    for pixel in [0, 7, 100, 400] {
        b.rgba[4 * pixel + 3] = 100;
    }
    let image = rendered(&a);
    let floats = |photo: &Photo| -> Vec<f64> {
        let pixels = photo.rgba.chunks_exact(4).zip(a.rgba.chunks_exact(4));
        pixels
            .flat_map(|(p, a)| if p[3] < 128 { [a[0], a[1], a[2]] } else { [p[0], p[1], p[2]] })
            .map(|v| f64::from(v) / 255.0)
            .collect()
    };
    let (x, y) = (floats(&a), floats(&b));
    for (range, signed) in [(InputRange::Signed, true), (InputRange::Published, false)] {
        let lpips = Lpips::new(gpu(), &weights, range, BAND_BYTES).unwrap();
        let ours = lpips.distance(&image, &b).unwrap();
        let twin = distance(network(), [height as usize, width as usize], [&x, &y], signed);
        println!("{range:?}: {ours} against {twin}, relative error {:.1e}", (ours / twin - 1.0).abs());
        assert!(twin > 0.01 && (ours - twin).abs() <= 1e-4 * twin, "{range:?}: {ours} against {twin}");
        assert!(lpips.distance(&image, &a).unwrap() < 1e-9, "an image differs from itself");
    }
    let lpips = Lpips::new(gpu(), &weights, InputRange::Signed, BAND_BYTES).unwrap();
    let small = photo(3, 40, 15);
    let text = lpips.distance(&rendered(&small), &small).unwrap_err().to_string();
    assert!(text.contains("40 x 15"), "{text}");
}

#[test]
fn bands_give_the_distance_of_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lpips.safetensors");
    write_network(&path);
    let weights = load(&[path]);
    let (width, height) = (16, 393);
    let (a, b) = (photo(4, width, height), photo(5, width, height));
    let with = |rows: u64| {
        let bytes = rows * 4 * 64 * u64::from(width);
        Lpips::new(gpu(), &weights, InputRange::Signed, bytes).unwrap().distance(&rendered(&a), &b)
    };
    let whole = with(393).unwrap();
    // Two bands of 192 rows and one of 9, too few for a feature of the last block; a few rows more make no larger band.
    let banded = with(2 * 96 + 192 + 5).unwrap();
    println!("whole {whole}, in bands {banded}");
    assert!((banded / whole - 1.0).abs() < 1e-5, "{banded} against {whole}");
    let Err(LpipsError::TooWide { bytes, .. }) = with(2 * 96) else { panic!("208 rows do not fit into 192") };
    assert_eq!(bytes, 208 * 4 * 64 * 16);
}

#[test]
fn two_files_are_as_good_as_one_and_bad_ones_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    write_network(&path("whole.safetensors"));
    let (trunk, mut linear) = tensors(false);
    write(&path("vgg16.safetensors"), &trunk);
    write(&path("vgg.safetensors"), &linear);
    let whole = load(&[path("whole.safetensors")]);
    assert!(load(&[path("vgg16.safetensors"), path("vgg.safetensors")]) == whole);
    assert!(load(&[path("vgg.safetensors"), path("vgg16.safetensors")]) == whole);
    let text = |names: &[&str]| {
        let paths: Vec<PathBuf> = names.iter().map(|name| path(name)).collect();
        LpipsWeights::load(&paths).unwrap_err().to_string()
    };
    let of_one = text(&["vgg.safetensors"]);
    assert!(
        of_one.contains("`net.slice1.0.weight` or `features.0.weight`") && of_one.contains("torchvision"),
        "{of_one}"
    );
    assert!(text(&["vgg16.safetensors"]).contains("lin0.model.1.weight"));
    linear[2].1 = vec![256];
    write(&path("shape.safetensors"), &linear);
    let shape = text(&["vgg16.safetensors", "shape.safetensors"]);
    assert!(
        shape.contains("lin2.model.1.weight") && shape.contains("[256]") && shape.contains("shape.safe"),
        "{shape}"
    );
    linear[2].1 = vec![1, 256, 1, 1];
    linear[3].2[5] = f32::NAN;
    write(&path("nan.safetensors"), &linear);
    let nan = text(&["vgg16.safetensors", "nan.safetensors"]);
    assert!(nan.contains("value 5") && nan.contains("lin3.model.1.weight") && nan.contains("nan.safe"), "{nan}");
}
