//! Sums of the rows of gradients of each Gaussian's intersections.

use ibgs_reference::gpu::gpu;
use ibgs_render::gpu::{Buffer, Pass};
use ibgs_shaders::bindings::{SumRowsBindings, SumRowsSurfaceBindings};
use ibgs_shaders::types::ViewUniforms;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const UNTOUCHED: f32 = 7.0;

/// Records the sums of every Gaussian, those of the planes too where there is a surface.
fn record(
    pass: &mut Pass,
    params: &ViewUniforms,
    lists: &[Buffer<u32>; 3],
    rows: &[Buffer<[f32; 4]>; 4],
    sums: &[Buffer<f32>; 6],
    surface: bool,
) {
    let [offsets, tile_counts, total] = lists;
    let [v_isect_color, v_isect_xy, v_isect_cov, v_isect_plane] = rows;
    let [v_rotations, v_means, v_opacity_logits, v_log_scales, v_normals, v_plane_offsets] = sums;
    let v_rotations = &v_rotations.cast();
    if surface {
        let buffers = SumRowsSurfaceBindings {
            offsets,
            tile_counts,
            total,
            v_isect_color,
            v_isect_xy,
            v_isect_cov,
            v_rotations,
            v_means,
            v_opacity_logits,
            v_log_scales,
            v_isect_plane,
            v_normals,
            v_plane_offsets,
        };
        pass.linear(&buffers, params, params.count as usize);
    } else {
        let buffers = SumRowsBindings {
            offsets,
            tile_counts,
            total,
            v_isect_color,
            v_isect_xy,
            v_isect_cov,
            v_rotations,
            v_means,
            v_opacity_logits,
            v_log_scales,
        };
        pass.linear(&buffers, params, params.count as usize);
    }
}

/// Few Gaussians have hundreds of rows, as in a scene; some have none.
#[test]
fn small_and_large_gaussians_have_the_sums_of_their_rows() {
    let gpu = gpu();
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for (n, most) in [(1, 700), (3, 17), (300, 40), (777, 2000)] {
        let mut counts: Vec<u32> = (0..n)
            .map(|_| match rng.random_range(0..10) {
                0..2 => 0,
                2 => rng.random_range(0..=most),
                _ => rng.random_range(1..=6),
            })
            .collect();
        let mut offsets = Vec::new();
        let mut total = 0;
        for count in &counts {
            offsets.push(total);
            total += count;
        }
        let mut rows: [Vec<f32>; 4] =
            std::array::from_fn(|_| (0..4 * total.max(1)).map(|_| rng.random_range(-1.0..1.0)).collect());
        // Some were counted and not found: their rows hold anything.
        let counted = counts.clone();
        for g in (0..n).step_by(3) {
            counts[g] -= counts[g] / 2;
            let lost = 4 * (offsets[g] + counts[g]) as usize..4 * (offsets[g] + counted[g]) as usize;
            rows.iter_mut().for_each(|row| row[lost.clone()].fill(f32::NAN));
        }
        for (room, surface) in [(total, false), (total, true), (total.saturating_sub(1), true)] {
            let fits = room == total;
            let upload = |values: &[u32]| gpu.upload("test", values).unwrap();
            let outputs = |width: usize| gpu.upload("test", &vec![UNTOUCHED; width * n]).unwrap();
            let lists = [upload(&offsets), upload(&counts), upload(&[total])];
            let inputs = rows.each_ref().map(|row| gpu.upload("test", row.as_chunks().0).unwrap());
            let out = [4, 3, 1, 3, 3, 1].map(outputs);
            let params = ViewUniforms { count: n as u32, capacity: room, ..ViewUniforms::default() };
            let mut pass = Pass::new(&gpu, "test");
            record(&mut pass, &params, &lists, &inputs, &out, surface);
            pass.submit();
            let found = out.each_ref().map(|buffer| gpu.read(buffer, buffer.rows()).unwrap());
            for (g, &first) in offsets.iter().enumerate() {
                let first = first as usize;
                let sum = |row: usize, c: usize| -> f64 {
                    (first..first + counts[g] as usize).map(|i| f64::from(rows[row][4 * i + c])).sum()
                };
                let expected: [Vec<f64>; 6] = [
                    (0..4).map(|c| sum(0, c)).collect(),
                    (0..3).map(|c| sum(1, c)).collect(),
                    vec![sum(1, 3)],
                    (0..3).map(|c| sum(2, c)).collect(),
                    (0..3).map(|c| sum(3, c)).collect(),
                    vec![sum(3, 3)],
                ];
                let written = fits && counts[g] > 0;
                for (index, expected) in expected.iter().enumerate() {
                    let width = expected.len();
                    for (c, expected) in expected.iter().enumerate() {
                        let expected = if written && (index < 4 || surface) { *expected } else { UNTOUCHED.into() };
                        let error = (f64::from(found[index][width * g + c]) - expected).abs();
                        assert!(error < 1e-4, "{n} Gaussians, {} rows of {g}, output {index}: {error:e}", counts[g]);
                    }
                }
            }
        }
    }
}
