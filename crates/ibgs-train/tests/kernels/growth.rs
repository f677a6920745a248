//! The default strategy's rounds.

use glam::{DMat3, DVec2, DVec3};
use ibgs_core::camera::Camera;
use ibgs_core::config::{DensifyConfig, GrowthConfig};
use ibgs_core::dataset::Point;
use ibgs_core::local_space::LocalSpace;
use ibgs_train::densify::default::{half_opacity, halves};
use ibgs_train::densify::free_space::{FreeSpace, NOWHERE};
use ibgs_train::densify::{Growth, Observations, Plan, Round, Strategy};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

const FRESH: u32 = 1 << 31;

/// Gaussians of (largest gradient, radius, opacity) in a row, seen once, longest along x.
fn observations(rows: &[(f32, f32, f64)]) -> Observations {
    Observations {
        statistics: rows.iter().map(|r| [r.0, 0.0, 1.0, r.1]).collect(),
        means: (0..rows.len()).map(|i| [i as f32, 0.0, 0.0]).collect(),
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; rows.len()],
        log_scales: vec![[0.1f32.ln(), 0.01f32.ln(), 0.01f32.ln()]; rows.len()],
        opacity_logits: rows.iter().map(|r| (r.2 / (1.0 - r.2)).ln() as f32).collect(),
    }
}

fn round(grows: bool, progress: f64) -> Round<'static> {
    Round {
        extent: 1.0,
        prune_length: 1.0,
        transparent: false,
        large: false,
        grows,
        progress,
        until_half: 0,
        free_space: &NOWHERE,
    }
}

fn planned(rows: &[(f32, f32, f64)], config: &DensifyConfig, round: &Round<'_>) -> Plan {
    Growth.plan(&observations(rows), config, round, &mut ChaCha8Rng::seed_from_u64(1))
}

fn with(growth: GrowthConfig) -> DensifyConfig {
    DensifyConfig { growth, ..DensifyConfig::default() }
}

fn opacities(plan: &Plan) -> Vec<f64> {
    let logits = plan.opacity_logits.as_ref().unwrap();
    logits.iter().map(|&x| 1.0 / (1.0 + (-f64::from(x)).exp())).collect()
}

/// Two halves have the whole's centre and, along the axes, its second moments.
#[test]
fn a_split_keeps_centre_and_spread() {
    let scales = [0.5, 0.2, 0.01];
    let (shrink, offset) = halves(scales);
    for a in 0..3 {
        let spread = (shrink[a] * scales[a]).powi(2) + offset[a].powi(2);
        assert!((spread / scales[a].powi(2) - 1.0).abs() < 1e-12, "axis {a}");
    }
    assert!((shrink[0] - 0.5f64.sqrt()).abs() < 1e-12 && shrink[2] > 0.999);
    assert!((half_opacity(0.5) - (1.0 - 0.5f64.powf(0.5f64.sqrt()))).abs() < 1e-12);

    let config = with(GrowthConfig { fraction: 1.0, opacity_decay: 0.0, ..GrowthConfig::default() });
    let plan = planned(&[(1.0, 0.1, 0.5)], &config, &round(true, 0.0));
    assert_eq!(plan.sources, [FRESH, FRESH], "both begin with moments of zero");
    let centre: Vec<f32> = (0..3).map(|a| plan.means[0][a] + plan.means[1][a]).collect();
    assert!(centre.iter().all(|c| c.abs() < 1e-6), "{centre:?}");
    assert!((plan.means[0][0].abs() - (0.1 * 0.5f32.sqrt())).abs() < 1e-6, "{:?}", plan.means);
    assert!((plan.log_scales[0][0] - (0.1 * 0.5f32.sqrt()).ln()).abs() < 1e-6);
    assert!(opacities(&plan).iter().all(|o| (o - half_opacity(0.5)).abs() < 1e-6));
}

#[test]
fn a_share_of_those_above_the_threshold_is_split() {
    let rows: Vec<_> = (0..400).map(|i| (if i < 200 { 0.01 } else { 0.001 }, 0.1, 0.5)).collect();
    let plan = planned(&rows, &DensifyConfig::default(), &round(true, 0.0));
    assert_eq!((plan.counts, plan.sources.len()), ([0, 50, 0], 450));
    assert!(plan.sources.iter().filter(|s| **s & FRESH != 0).all(|s| s & !FRESH < 200));
    // Once growth has ended nothing is split.
    assert_eq!(planned(&rows, &DensifyConfig::default(), &round(false, 0.6)).counts, [0; 3]);
    // The cap is kept.
    let capped = DensifyConfig { max_splats: Some(410), ..DensifyConfig::default() };
    assert_eq!(planned(&rows, &capped, &round(true, 0.0)).sources.len(), 410);
    let full = DensifyConfig { max_splats: Some(10), ..DensifyConfig::default() };
    assert_eq!(planned(&rows, &full, &round(true, 0.0)).sources.len(), 400);
}

#[test]
fn the_weights_of_the_draw_count() {
    let rows: Vec<_> = (0..1000).map(|i| (if i % 2 == 0 { 0.03 } else { 0.003 }, 0.1, 0.5)).collect();
    let plan = planned(&rows, &DensifyConfig::default(), &round(true, 0.0));
    assert_eq!(plan.counts[1], 250);
    let even = plan.sources[1000..].iter().filter(|s| **s & 1 == 0).count();
    assert!((200..250).contains(&even), "{even} of 250 have ten times the gradient");
}

#[test]
fn what_has_faded_is_pruned_and_replaced() {
    let mut rows = vec![(0.0, 0.1, 0.5); 100];
    rows[..10].fill((0.0, 0.1, 0.003));
    let plan = planned(&rows, &DensifyConfig::default(), &round(true, 0.0));
    assert_eq!((plan.counts, plan.sources.len()), ([0, 10, 10], 100));
    assert!(plan.sources.iter().all(|s| s & !FRESH >= 10));
    // Pruning goes on, replacement does not.
    assert_eq!(planned(&rows, &DensifyConfig::default(), &round(false, 0.9)).sources.len(), 90);
}

#[test]
fn what_is_not_finite_or_beyond_the_scene_is_pruned() {
    let mut o = observations(&[(0.0, 0.1, 0.5); 4]);
    o.means[0][1] = f32::NAN;
    o.log_scales[1][2] = 101f32.ln();
    o.rotations[2][0] = f32::INFINITY;
    let plan = Growth.plan(&o, &DensifyConfig::default(), &round(false, 0.0), &mut ChaCha8Rng::seed_from_u64(1));
    assert_eq!(plan.sources, [3]);
}

#[test]
fn what_is_in_free_space_is_pruned_and_replaced() {
    let (focal, principal) = (DVec2::splat(50.0), DVec2::splat(50.0));
    let (view_from_world, translation) = (DMat3::IDENTITY, DVec3::ZERO);
    let camera = Camera { width: 100, height: 100, focal, principal, view_from_world, translation };
    let points = vec![Point { position: DVec3::new(0.0, 0.0, 5.0), color: [0; 3] }; 20];
    let free_space = FreeSpace::new(&[camera], (&points, &LocalSpace::default()), 0.5);
    // One unit apart; the first three are nearer to the camera than 2.5.
    let rows = [(0.0, 0.1, 0.5); 10];
    let plan = planned(&rows, &DensifyConfig::default(), &Round { free_space: &free_space, ..round(true, 0.0) });
    assert_eq!((plan.counts, plan.sources.len()), ([0, 3, 3], 10));
    assert!(plan.sources.iter().all(|s| s & !FRESH >= 3));
}

#[test]
fn opacities_fade_less_and_less() {
    let rows = [(0.0, 0.1, 0.5), (0.0, 0.1, 0.0045)];
    for (grows, progress) in [(true, 0.0), (false, 0.75)] {
        let faded = opacities(&planned(&rows, &DensifyConfig::default(), &round(grows, progress)));
        assert!((faded[0] - (0.5 - 0.004 * (1.0 - progress))).abs() < 1e-6, "{faded:?}");
        assert!(faded[1] > 0.0 && faded[1] < 0.0045);
    }
    let stays = with(GrowthConfig { opacity_decay: 0.0, ..GrowthConfig::default() });
    let plan = planned(&rows, &stays, &round(false, 0.75));
    assert_eq!(plan.opacity_logits.unwrap(), observations(&rows).opacity_logits, "bit for bit");
}

#[test]
fn what_fills_half_of_the_screen_is_split() {
    let rows = [(0.0, 0.6, 0.5), (0.0, 0.4, 0.5)];
    assert_eq!(planned(&rows, &DensifyConfig::default(), &round(true, 0.0)).sources, [FRESH, 1, FRESH]);
    let off = with(GrowthConfig { screen_size: 0.0, ..GrowthConfig::default() });
    assert_eq!(planned(&rows, &off, &round(true, 0.0)).sources, [0, 1]);
}
