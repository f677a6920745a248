//! Densification: the kernels that carry a plan out. The plans' rules are tested beside them.

use ibgs_core::gpu::{Buffer, Gpu, Pass};
use ibgs_reference::gpu::gpu;
use ibgs_reference::random_scene::random_params;
use ibgs_shaders::bindings::{DensifyGatherBindings, DensifyObserveBindings};
use ibgs_shaders::types::{GatherParams, ObserveParams};

const FRESH: u32 = 1 << 31;

/// A view of three Gaussians: sums by screen position, depth and radius, and tiles of each.
struct Seen {
    sums: [[f32; 4]; 3],
    shapes: [[f32; 2]; 3],
    tiles: [u32; 3],
}

/// Adds a view, with so many intersections in all, to the statistics.
fn observe(gpu: &Gpu, statistics: &Buffer<[f32; 4]>, params: &ObserveParams, view: &Seen, isects: u32) {
    let projected: Vec<[f32; 4]> =
        view.shapes.iter().flat_map(|&[depth, radius]| [[0.0; 4], [0.0, 0.0, depth, radius], [0.0; 4]]).collect();
    let v_means: Vec<f32> = view.sums.iter().flat_map(|&[x, y, width, _]| [x, y, width]).collect();
    let buffers = DensifyObserveBindings {
        projected: &gpu.upload("projected", &projected).unwrap(),
        tile_counts: &gpu.upload("tile counts", &view.tiles).unwrap(),
        total: &gpu.upload("total", &[isects]).unwrap(),
        v_means: &gpu.upload("gradient", &v_means).unwrap(),
        v_opacity_logits: &gpu.upload("gradient", &view.sums.map(|sums| sums[3])).unwrap(),
        statistics,
    };
    let mut pass = Pass::new(gpu, "test");
    pass.linear(&buffers, params, 3);
    pass.submit();
}

fn assert_close(a: [f32; 4], b: [f32; 4]) {
    assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5), "{a:?} in place of {b:?}");
}

#[test]
fn statistics_grow_only_where_the_gaussian_was_seen() {
    let gpu = gpu();
    // Far and seen, culled, and at half the near depth.
    let view = Seen {
        sums: [[3e-3, 4e-3, 5e-3, 12e-3], [f32::NAN; 4], [3e-3, 4e-3, 5e-3, 12e-3]],
        shapes: [[5.0, 9.0], [0.0, 0.0], [1.0, 2.0]],
        tiles: [1, 0, 2],
    };
    for (near_depth, factor) in [(2.0, 0.25), (0.0, 1.0)] {
        let start = [[1.0f32, 2.0, 3.0, 4.0], [1.0, 2.0, 3.0, 40.0], [0.0; 4]];
        let statistics = gpu.upload("statistics", &start).unwrap();
        let params = ObserveParams { size: [200, 200], count: 3, near_depth, largest: 0, capacity: 3 };
        observe(&gpu, &statistics, &params, &view, 3);
        let ours = gpu.read(&statistics, 3).unwrap();
        assert_close(ours[0], [1.0 + 0.5, 2.0 + 1.3, 4.0, 9.0]);
        assert_eq!(ours[1], start[1], "culled");
        assert_close(ours[2], [0.5 * factor, 1.3 * factor, 1.0, 2.0]);
    }
}

#[test]
fn the_largest_gradient_over_the_views_is_kept() {
    let gpu = gpu();
    let statistics = gpu.upload("statistics", &[[0.0f32; 4]; 3]).unwrap();
    let params = ObserveParams { size: [200, 100], count: 3, near_depth: 1.0, largest: 1, capacity: 10 };
    let shapes = [[0.1, 50.0], [5.0, 9.0], [0.0, 0.0]];
    // The second view has a larger absolute gradient, and the second Gaussian reaches none of its tiles. The third has too little
    // room, the last no gradients.
    for (sums, tiles, isects) in [
        ([[3e-3f32, 8e-3, 5e-3, 24e-3], [0.0, 1e-3, 0.0, 1e-3], [1.0; 4]], [9, 1, 0], 10),
        ([[-1e-3, 0.0, 0.02, 0.03], [f32::NAN; 4], [1.0; 4]], [9, 0, 0], 9),
        ([[1.0; 4]; 3], [9, 2, 0], 11),
        ([[0.0; 4]; 3], [9, 1, 0], 10),
    ] {
        observe(&gpu, &statistics, &params, &Seen { sums, shapes, tiles }, isects);
    }
    let ours = gpu.read(&statistics, 3).unwrap();
    assert_close(ours[0], [5.0, 0.0, 3.0, 0.25]);
    assert_close(ours[1], [0.1, 0.0, 3.0, 0.045]);
    assert_eq!(ours[2], [0.0; 4], "culled");
}

#[test]
fn rows_are_gathered_and_new_moments_are_zero() {
    let gpu = gpu();
    let p = random_params(9, 1, 3);
    let previous: Vec<u32> = p.sh.iter().map(|v| (*v as f32).to_bits()).collect();
    let row = previous.len() / 9;
    let from = gpu.upload("from", &previous).unwrap();
    let sources = [8u32, 0, FRESH | 4, 4];
    let list = gpu.upload("sources", &sources).unwrap();
    for fresh_zero in [0, 1] {
        let to = gpu.upload("to", &vec![u32::MAX; 4 * row]).unwrap();
        let params = GatherParams { count: 4 * row as u32, row: row as u32, fresh_zero, pad: 0 };
        let mut pass = Pass::new(&gpu, "test");
        let buffers = DensifyGatherBindings { sources: &list, previous: &from, next: &to };
        pass.linear(&buffers, &params, 4 * row);
        pass.submit();
        let ours = gpu.read(&to, 4 * row).unwrap();
        for (k, source) in sources.iter().enumerate() {
            let fresh = source & FRESH != 0 && fresh_zero == 1;
            let at = (source & !FRESH) as usize * row;
            let expected: Vec<u32> = previous[at..at + row].iter().map(|v| if fresh { 0 } else { *v }).collect();
            assert_eq!(ours[k * row..(k + 1) * row], expected, "row {k}, fresh_zero {fresh_zero}");
        }
    }
}
