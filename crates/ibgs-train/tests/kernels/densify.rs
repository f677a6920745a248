//! Densification: the plan's rules, and the kernels that carry it out.

use glam::DVec3;
use ibgs_core::config::{DensifyConfig, Strategy};
use ibgs_core::gpu::Pass;
use ibgs_reference::gpu::gpu;
use ibgs_reference::random_scene::random_params;
use ibgs_shaders::bindings::{DensifyGatherBindings, DensifyObserveBindings};
use ibgs_shaders::types::{GatherParams, ObserveParams};
use ibgs_train::densify::free_space::NOWHERE;
use ibgs_train::densify::{Observations, Plan, Round, distance_length, strategy};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

const FRESH: u32 = 1 << 31;

fn round() -> Round<'static> {
    Round {
        extent: 1.0,
        prune_length: 1.0,
        transparent: true,
        large: false,
        grows: true,
        progress: 0.0,
        until_half: 0,
        free_space: &NOWHERE,
    }
}

fn published() -> DensifyConfig {
    DensifyConfig { strategy: Strategy::Published, ..DensifyConfig::default() }
}

/// One Gaussian each: (gradient sum, absolute sum, views, radius), log scale, opacity logit.
fn observations(rows: &[([f32; 4], f32, f32)]) -> Observations {
    Observations {
        statistics: rows.iter().map(|r| r.0).collect(),
        means: (0..rows.len()).map(|i| [i as f32, 0.0, 0.0]).collect(),
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; rows.len()],
        log_scales: rows.iter().map(|r| [r.1; 3]).collect(),
        opacity_logits: rows.iter().map(|r| r.2).collect(),
    }
}

fn planned(rows: &[([f32; 4], f32, f32)], config: &DensifyConfig, round: &Round<'_>) -> Plan {
    strategy(config.strategy).plan(&observations(rows), config, round, &mut ChaCha8Rng::seed_from_u64(1))
}

#[test]
fn small_ones_are_cloned_large_ones_split_quiet_ones_kept() {
    let (small, large) = (0.0005f32.ln(), 0.05f32.ln());
    let rows = [
        ([1e-3, 0.0, 2.0, 5.0], small, 1.0),
        ([1e-3, 0.0, 2.0, 5.0], large, 1.0),
        ([1e-4, 0.0, 2.0, 5.0], large, 1.0),
        // Never seen: no division by zero views.
        ([0.0, 0.0, 0.0, 0.0], small, 1.0),
    ];
    let plan = planned(&rows, &published(), &round());
    assert_eq!(plan.sources, [0, 2, 3, FRESH, FRESH | 1, FRESH | 1]);
    assert_eq!(plan.counts, [1, 1, 0]);
    assert_eq!(plan.means[..3], [[0.0; 3], [2.0, 0.0, 0.0], [3.0, 0.0, 0.0]]);
    assert_ne!(plan.means[3], [0.0; 3], "the copy is drawn from the Gaussian");
    assert!((plan.log_scales[4][0] - (large - 1.6f32.ln())).abs() < 1e-6);
    assert_eq!(plan.log_scales[3], [small; 3]);
    assert_ne!(plan.means[4], plan.means[5]);
}

#[test]
fn absolute_gradients_split_wide_ones_and_the_largest_win() {
    let large = 0.05f32.ln();
    let rows = [
        ([0.0, 2e-3, 1.0, 21.0], large, 1.0),
        ([0.0, 3e-3, 1.0, 21.0], large, 1.0),
        ([0.0, 3e-3, 1.0, 20.0], large, 1.0),
        ([0.0, 3e-3, 1.0, 90.0], 0.0005f32.ln(), 1.0),
        ([0.0, 7e-4, 1.0, 90.0], large, 1.0),
    ];
    let config = published();
    assert_eq!(planned(&rows, &config, &round()).counts, [0, 2, 0]);
    let one = DensifyConfig { abs_max_per_round: 1, ..config.clone() };
    let plan = planned(&rows, &one, &round());
    assert_eq!(plan.sources, [0, 2, 3, 4, FRESH | 1, FRESH | 1]);
    let off = DensifyConfig { abs_split: false, ..config };
    assert_eq!(planned(&rows, &off, &round()).counts, [0, 0, 0]);
}

#[test]
fn absgs_splits_by_the_absolute_gradient_alone() {
    let (small, large) = (0.0005f32.ln(), 0.05f32.ln());
    let rows = [
        ([1e-3, 0.0, 1.0, 90.0], large, 1.0),
        ([0.0, 5e-4, 1.0, 1.0], large, 1.0),
        ([0.0, 3e-4, 1.0, 90.0], large, 1.0),
        ([3e-4, 0.0, 1.0, 1.0], small, 1.0),
        ([1e-4, 9e-3, 1.0, 1.0], small, 1.0),
    ];
    let config = DensifyConfig { strategy: Strategy::AbsGs, abs_max_per_round: 0, ..DensifyConfig::default() };
    let plan = planned(&rows, &config, &round());
    assert_eq!(plan.sources, [0, 2, 3, 4, FRESH | 3, FRESH | 1, FRESH | 1]);
    // Where there is room for one, gradients are weighed by their thresholds.
    let one = DensifyConfig { max_splats: Some(6), ..config };
    assert_eq!(planned(&rows, &one, &round()).counts, [1, 0, 0]);
}

#[test]
fn pruning_takes_the_transparent_and_later_the_large() {
    let rows = [([0.0; 4], 0.01f32.ln(), -3.5), ([0.0; 4], 0.2f32.ln(), 1.0), ([0.0; 4], 0.01f32.ln(), 1.0)];
    let config = published();
    assert_eq!(planned(&rows, &config, &round()).sources, [1, 2]);
    assert_eq!(planned(&rows, &config, &Round { large: true, ..round() }).sources, [2]);
    assert_eq!(planned(&rows, &config, &Round { transparent: false, ..round() }).sources, [0, 1, 2]);
}

#[test]
fn far_scenes_are_measured_by_their_distance() {
    let far = |x: f32| [[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [1e6, 0.0, 0.0], [x - 1.0, 0.0, 0.0], [x + 0.5, 0.0, 0.0]];
    let centre = DVec3::new(-1.0, 0.0, 0.0);
    assert_eq!(distance_length(&far(9.0), centre, 2.0), 10.5);
    assert_eq!(distance_length(&far(4.0), centre, 2.0), 2.0);
    assert_eq!(distance_length(&[], centre, 2.0), 2.0);
    let rows = [([0.0; 4], 0.25f32.ln(), 1.0); 3];
    let round = Round { large: true, ..round() };
    assert_eq!(planned(&rows, &published(), &round).sources, [0; 0]);
    assert_eq!(planned(&rows, &published(), &Round { prune_length: 3.0, ..round }).sources, [0, 1, 2]);
}

#[test]
fn the_cap_is_never_passed() {
    let rows: Vec<_> = (0..50).map(|i| ([1e-3 * (1 + i) as f32, 0.0, 1.0, 1.0], 0.05f32.ln(), 1.0)).collect();
    let config = DensifyConfig { max_splats: Some(55), ..published() };
    let plan = planned(&rows, &config, &round());
    assert_eq!(plan.sources.len(), 55);
    // The largest gradients.
    assert!(plan.sources.iter().filter(|s| **s & FRESH != 0).all(|s| s & !FRESH >= 45));
}

#[test]
fn a_plan_is_repeatable() {
    let rows = [([1e-3, 0.0, 1.0, 1.0], 0.05f32.ln(), 1.0)];
    let config = published();
    assert_eq!(planned(&rows, &config, &round()), planned(&rows, &config, &round()));
}

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
    let previous: Vec<f32> = p.sh.iter().map(|v| *v as f32).collect();
    let row = previous.len() / 9;
    let from = gpu.upload("from", &previous).unwrap();
    let sources = [8u32, 0, FRESH | 4, 4];
    let list = gpu.upload("sources", &sources).unwrap();
    for fresh_zero in [0, 1] {
        let to = gpu.upload("to", &vec![f32::NAN; 4 * row]).unwrap();
        let params = GatherParams { count: 4 * row as u32, row: row as u32, fresh_zero, pad: 0 };
        let mut pass = Pass::new(&gpu, "test");
        let buffers = DensifyGatherBindings { sources: &list, previous: &from, next: &to };
        pass.linear(&buffers, &params, 4 * row);
        pass.submit();
        let ours = gpu.read(&to, 4 * row).unwrap();
        for (k, source) in sources.iter().enumerate() {
            let fresh = source & FRESH != 0 && fresh_zero == 1;
            let at = (source & !FRESH) as usize * row;
            let expected: Vec<f32> = previous[at..at + row].iter().map(|v| if fresh { 0.0 } else { *v }).collect();
            assert_eq!(ours[k * row..(k + 1) * row], expected, "row {k}, fresh_zero {fresh_zero}");
        }
    }
}
