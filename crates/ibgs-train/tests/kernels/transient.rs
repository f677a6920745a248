//! Cells of a photo, and masks in its alpha.

use ibgs_core::gpu::Pass;
use ibgs_reference::gpu::gpu;
use ibgs_reference::transients::{cells, masked_alpha};
use ibgs_shaders::bindings::{TransientCellsBindings, TransientMaskBindings};
use ibgs_shaders::types::TransientParams;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Sources of a pixel.
const VISIBLE: usize = 3;
/// Alphas on both sides of the thresholds.
const ALPHAS: [u8; 6] = [0, 1, 126, 127, 128, 255];

fn params(size: [u32; 2], visible: usize, fresh: bool) -> TransientParams {
    let cells = size.map(|n| n.div_ceil(8));
    TransientParams { size, cells, visible: visible as u32, fresh: fresh.into(), ..TransientParams::default() }
}

fn photo(rng: &mut ChaCha8Rng, pixels: usize) -> Vec<[u8; 4]> {
    (0..pixels).map(|_| [rng.random(), rng.random(), rng.random(), ALPHAS[rng.random_range(0..6)]]).collect()
}

fn words(photo: &[[u8; 4]]) -> Vec<u32> {
    photo.iter().map(|texel| u32::from_le_bytes(*texel)).collect()
}

#[test]
fn cells_are_those_of_the_twin() {
    let (gpu, mut rng) = (gpu(), ChaCha8Rng::seed_from_u64(3));
    for (size, visible) in [([8, 8], 3), ([1, 1], 3), ([37, 19], 3), ([37, 19], 0), ([200, 150], 3)] {
        let pixels = (size[0] * size[1]) as usize;
        let photo = photo(&mut rng, pixels);
        let image: Vec<[f32; 3]> = (0..pixels).map(|_| rng.random()).collect();
        let warped: Vec<[f32; 4]> = (0..VISIBLE * pixels).map(|_| rng.random()).collect();
        // Nothing there, or an error of the depth from 0, up to and beyond what agrees.
        let seen: Vec<[u8; 4]> = (0..pixels)
            .map(|_| std::array::from_fn(|_| [255, 0x00, 0x21, 0x30, 0xe2][rng.random_range(0..5)]))
            .collect();
        let sources: Vec<Vec<[f64; 3]>> = (0..pixels)
            .map(|p| {
                let agrees = (0..visible).filter(|m| seen[p][*m] >> 4 < 3);
                agrees.map(|m| [0, 1, 2].map(|c| f64::from(warped[m * pixels + p][c]))).collect()
            })
            .collect();
        let exact: Vec<_> = image.iter().map(|c| c.map(f64::from)).collect();
        let truth = cells(&photo, size[0] as usize, &exact, &sources);
        let uploaded = gpu.upload("photo", &words(&photo)).unwrap();
        let image = gpu.upload("image", image.as_flattened()).unwrap();
        let warped = gpu.upload("warped", warped.as_flattened()).unwrap();
        let seen = gpu.upload("seen", &words(&seen)).unwrap();
        let sums = gpu.upload("sums", &vec![[f32::NAN; 4]; 2 * truth.len()]).unwrap();
        let mut pass = Pass::new(&gpu, "test");
        let bindings =
            TransientCellsBindings { photo: &uploaded, image: &image, warped: &warped, seen: &seen, sums: &sums };
        pass.linear(&bindings, &params(size, visible, false), truth.len());
        pass.submit();
        let found = gpu.read(&sums, 2 * truth.len()).unwrap();
        for (found, truth) in found.as_flattened().iter().zip(truth.as_flattened().as_flattened()) {
            assert!((f64::from(*found) - truth).abs() < 2e-5, "{size:?}: {found} against {truth}");
        }
        // A single pixel may have no source that agrees.
        let any = truth.iter().any(|cell| cell[1][3] > 0.0);
        assert!(pixels == 1 || any == (visible > 0), "{size:?}");
    }
}

#[test]
fn masks_come_and_go() {
    let (gpu, mut rng) = (gpu(), ChaCha8Rng::seed_from_u64(4));
    let (size, width) = ([37, 19], 37);
    let photo = photo(&mut rng, 37 * 19);
    let own: Vec<u8> = photo.iter().map(|texel| texel[3]).collect();
    let uploaded = gpu.upload("photo", &words(&photo)).unwrap();
    for fresh in [true, false, false] {
        let mask: Vec<bool> = (0..15).map(|_| rng.random()).collect();
        let words: Vec<u32> = mask.iter().map(|hidden| u32::from(*hidden)).collect();
        let mask_words = gpu.upload("mask", &words).unwrap();
        let mut pass = Pass::new(&gpu, "test");
        let bindings = TransientMaskBindings { mask: &mask_words, photo: &uploaded };
        pass.linear(&bindings, &params(size, 0, fresh), photo.len());
        pass.submit();
        let found: Vec<[u8; 4]> = gpu.read(&uploaded, photo.len()).unwrap().into_iter().map(u32::to_le_bytes).collect();
        let alpha: Vec<u8> = found.iter().map(|texel| texel[3]).collect();
        assert_eq!(alpha, masked_alpha(&own, width, &mask));
        assert!(found.iter().zip(&photo).all(|(found, photo)| found[..3] == photo[..3]), "colours stay");
    }
}
