//! The evidence of a photo's cells.

use ibgs_core::gpu::Pass;
use ibgs_reference::gpu::gpu;
use ibgs_reference::transients::{Compared, Evidence, visited};
use ibgs_shaders::bindings::TransientCellsBindings;
use ibgs_shaders::types::TransientParams;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Sources of a pixel.
const VISIBLE: usize = 3;
const RATE: f32 = 0.3;
/// Alphas on both sides of the thresholds.
const ALPHAS: [u8; 6] = [0, 1, 126, 127, 128, 255];

#[test]
fn evidence_is_that_of_the_twin() {
    let (gpu, mut rng) = (gpu(), ChaCha8Rng::seed_from_u64(3));
    for (size, side, visible) in
        [([8, 8], 8, 3), ([1, 1], 4, 3), ([37, 19], 4, 3), ([37, 19], 5, 0), ([37, 19], 64, 3), ([200, 150], 4, 3)]
    {
        let pixels = (size[0] * size[1]) as usize;
        let cells = size.map(|n: u32| n.div_ceil(side));
        let count = (cells[0] * cells[1]) as usize;
        let mut photo: Vec<[u8; 4]> =
            (0..pixels).map(|_| [rng.random(), rng.random(), rng.random(), ALPHAS[rng.random_range(0..6)]]).collect();
        if count > 2 {
            // A cell of which there is no photo.
            let inside =
                |p: usize| p % size[0] as usize / side as usize == 1 && p / size[0] as usize / side as usize == 0;
            photo.iter_mut().enumerate().filter(|(p, _)| inside(*p)).for_each(|(_, texel)| texel[3] = 126);
        }
        let image: Vec<[f32; 3]> = (0..pixels).map(|_| rng.random()).collect();
        let warped: Vec<[f32; 4]> = (0..VISIBLE * pixels).map(|_| rng.random()).collect();
        // Nothing there, or an error of the depth from 0, up to and beyond what agrees.
        let seen: Vec<[u8; 4]> = (0..pixels)
            .map(|_| std::array::from_fn(|_| [255, 255, 255, 0x21, 0x30, 0xe2][rng.random_range(0..6)]))
            .collect();
        let sources: Vec<Vec<[f64; 3]>> = (0..pixels)
            .map(|p| {
                let agrees = (0..visible).filter(|m| seen[p][*m] >> 4 < 3);
                agrees.map(|m| [0, 1, 2].map(|c| f64::from(warped[m * pixels + p][c]))).collect()
            })
            .collect();
        let before: Vec<[[f32; 4]; 3]> = (0..count).map(|_| rng.random()).collect();
        let exact: Vec<_> = image.iter().map(|c| c.map(f64::from)).collect();
        let it = Compared { photo: &photo, width: size[0] as usize, image: &exact, sources: &sources };
        let old: Vec<Evidence> = before.iter().map(|rows| rows.map(|row| row.map(f64::from))).collect();
        let truth = visited(&old, &it, side as usize, RATE.into());
        let words: Vec<u32> = photo.iter().map(|texel| u32::from_le_bytes(*texel)).collect();
        let seen: Vec<u32> = seen.iter().map(|bytes| u32::from_le_bytes(*bytes)).collect();
        let photo = gpu.upload("photo", &words).unwrap();
        let image = gpu.upload("image", image.as_flattened()).unwrap();
        let warped = gpu.upload("warped", warped.as_flattened()).unwrap();
        let seen = gpu.upload("seen", &seen).unwrap();
        let evidence = gpu.upload("evidence", before.as_flattened()).unwrap();
        let bindings =
            TransientCellsBindings { photo: &photo, image: &image, warped: &warped, seen: &seen, evidence: &evidence };
        let visible = visible as u32;
        let params = TransientParams { size, cells, side, visible, rate: RATE, ..TransientParams::default() };
        let mut pass = Pass::new(&gpu, "test");
        pass.linear(&bindings, &params, count);
        pass.submit();
        let found = gpu.read(&evidence, 3 * count).unwrap();
        for (found, truth) in found.as_flattened().iter().zip(truth.as_flattened().as_flattened()) {
            assert!((f64::from(*found) - truth).abs() < 2e-5, "{size:?}: {found} against {truth}");
        }
        if count > 2 {
            assert_eq!(found[3..6], before[1], "nothing is learned of what is not there");
            assert!(visible == 0 || truth.iter().zip(&old).any(|(new, old)| new[1] != old[1]));
            assert!(visible == 0 || truth.iter().zip(&old).any(|(new, old)| new[0] != old[0] && new[1] == old[1]));
        }
    }
}
