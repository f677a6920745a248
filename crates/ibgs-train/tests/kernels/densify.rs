//! Densification: the kernels that carry a plan out. The plans' rules are tested beside them.

use ibgs_core::gpu::Pass;
use ibgs_reference::gpu::gpu;
use ibgs_reference::random_scene::random_params;
use ibgs_shaders::bindings::{DensifyGatherBindings, DensifyObserveBindings};
use ibgs_shaders::types::{GatherParams, ObserveParams};

const FRESH: u32 = 1 << 31;

#[test]
fn statistics_grow_only_where_the_gaussian_was_seen() {
    let gpu = gpu();
    let gradient =
        gpu.upload("gradient", &[[3e-3f32, 4e-3, 5e-3, 12e-3], [1.0; 4], [3e-3, 4e-3, 5e-3, 12e-3]]).unwrap();
    // Depth and radius: far and seen, culled, and at half the near depth.
    let mut projected = [[0.0f32; 4]; 9];
    (projected[1][2], projected[1][3]) = (5.0, 9.0);
    (projected[7][2], projected[7][3]) = (1.0, 2.0);
    let projected = gpu.upload("projected", &projected).unwrap();
    for (near_depth, factor) in [(2.0, 0.25), (0.0, 1.0)] {
        let start = [[1.0f32, 2.0, 3.0, 4.0], [1.0, 2.0, 3.0, 40.0], [0.0; 4]];
        let statistics = gpu.upload("statistics", &start).unwrap();
        let params = ObserveParams { size: [200, 200], count: 3, near_depth, largest: 0, pad: 0 };
        let mut pass = Pass::new(&gpu, "test");
        let buffers = DensifyObserveBindings { v_screen: &gradient, projected: &projected, statistics: &statistics };
        pass.linear(&buffers, &params, 3);
        pass.submit();
        let ours = gpu.read(&statistics, 3).unwrap();
        let close = |a: [f32; 4], b: [f32; 4]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5);
        assert!(close(ours[0], [1.0 + 0.5, 2.0 + 1.3, 4.0, 9.0]), "{:?}", ours[0]);
        assert_eq!(ours[1], start[1], "culled");
        assert!(close(ours[2], [0.5 * factor, 1.3 * factor, 1.0, 2.0]), "near depth {near_depth}: {:?}", ours[2]);
    }
}

#[test]
fn the_largest_gradient_over_the_views_is_kept() {
    let gpu = gpu();
    let mut projected = [[0.0f32; 4]; 9];
    (projected[1][2], projected[1][3]) = (0.1, 50.0);
    (projected[4][2], projected[4][3]) = (5.0, 9.0);
    let projected = gpu.upload("projected", &projected).unwrap();
    let statistics = gpu.upload("statistics", &[[0.0f32; 4]; 3]).unwrap();
    // The second view has a larger absolute gradient, and too little room for the second Gaussian.
    for rows in [
        [[3e-3f32, 8e-3, 5e-3, 24e-3], [0.0, 1e-3, 0.0, 1e-3], [1.0; 4]],
        [[-1e-3, 0.0, 0.02, 0.03], [1.0, 1.0, 1.0, -1.0], [1.0; 4]],
        [[0.0; 4]; 3],
    ] {
        let params = ObserveParams { size: [200, 100], count: 3, near_depth: 1.0, largest: 1, pad: 0 };
        let gradient = gpu.upload("gradient", &rows).unwrap();
        let mut pass = Pass::new(&gpu, "test");
        let buffers = DensifyObserveBindings { v_screen: &gradient, projected: &projected, statistics: &statistics };
        pass.linear(&buffers, &params, 3);
        pass.submit();
    }
    let ours = gpu.read(&statistics, 3).unwrap();
    let close = |a: [f32; 4], b: [f32; 4]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5);
    assert!(close(ours[0], [5.0, 0.0, 3.0, 0.25]), "{:?}", ours[0]);
    assert!(close(ours[1], [0.1, 0.0, 2.0, 0.045]), "{:?}", ours[1]);
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
