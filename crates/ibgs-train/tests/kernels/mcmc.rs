//! The strategy `mcmc`: its plan, its noise and its penalties.

use glam::{DMat3, DQuat, DVec3};
use ibgs_core::config::{DensifyConfig, Strategy};
use ibgs_core::gpu::Pass;
use ibgs_reference::gpu::gpu;
use ibgs_shaders::bindings::McmcNoiseBindings;
use ibgs_shaders::types::McmcNoiseParams;
use ibgs_train::densify::free_space::NOWHERE;
use ibgs_train::densify::mcmc::shared;
use ibgs_train::densify::{Mcmc, Observations, Plan, Round, Strategy as _};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const FRESH: u32 = 1 << 31;

fn config(most: u32) -> DensifyConfig {
    DensifyConfig { strategy: Strategy::Mcmc, max_splats: Some(most), ..DensifyConfig::default() }
}

/// A plan for Gaussians of these opacities.
fn planned(opacities: &[f32], config: &DensifyConfig) -> Plan {
    let n = opacities.len();
    let observations = Observations {
        statistics: vec![[0.0; 4]; n],
        means: (0..n).map(|i| [i as f32, 0.0, 0.0]).collect(),
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; n],
        log_scales: vec![[0.0; 3]; n],
        opacity_logits: opacities.iter().map(|o| (o / (1.0 - o)).ln()).collect(),
    };
    let round = Round {
        extent: 1.0,
        prune_length: 1.0,
        transparent: true,
        large: true,
        grows: true,
        progress: 0.0,
        until_half: 0,
        free_space: &NOWHERE,
    };
    Mcmc.plan(&observations, config, &round, &mut ChaCha8Rng::seed_from_u64(2))
}

#[test]
fn no_gradients_are_looked_at() {
    assert!(Mcmc.reduction(&config(9), 1.0).is_none());
}

#[test]
fn shared_opacity_stops_the_same_light_and_keeps_the_picture() {
    for (o, copies) in [(0.3, 1), (0.3, 2), (0.9, 5), (0.999, 51), (0.01, 51)] {
        let (each, factor) = shared(o, copies);
        assert!((1.0 - (1.0 - each).powi(copies as i32) - o).abs() < 1e-12);
        // What a ray through the middle of a line of equal one-dimensional Gaussians stops, integrated over the line: the
        // same before and after.
        let integral =
            |stops: &dyn Fn(f64) -> f64| (-60_000..60_000).map(|i| stops(f64::from(i) * 2e-4) * 2e-4).sum::<f64>();
        let before = integral(&|x| o * (-0.5 * x * x).exp());
        let after = integral(&|x| 1.0 - (1.0 - each * (-0.5 * (x / factor).powi(2)).exp()).powi(copies as i32));
        assert!((before / after - 1.0).abs() < 1e-6, "{o}, {copies} copies: {before} against {after}");
    }
}

#[test]
fn the_transparent_move_and_the_number_grows_to_the_cap() {
    let opacities: Vec<f32> = (0..100).map(|i| if i % 10 == 0 { 0.004 } else { 0.5 }).collect();
    let plan = planned(&opacities, &config(1000));
    assert_eq!((plan.sources.len(), plan.counts), (105, [5, 0, 10]));
    assert!(plan.sources.iter().all(|s| !(s & !FRESH).is_multiple_of(10)), "nothing comes from a dead one");
    let logits = plan.opacity_logits.as_ref().unwrap();
    for (k, source) in plan.sources.iter().enumerate() {
        let source = source & !FRESH;
        let copies = plan.sources.iter().filter(|s| *s & !FRESH == source).count() as u32;
        let (each, factor) = shared(0.5, copies);
        assert!((f64::from(logits[k]) - (each / (1.0 - each)).ln()).abs() < 1e-5);
        assert!((f64::from(plan.log_scales[k][0]) - factor.ln()).abs() < 1e-5);
        assert_eq!(plan.sources[k] & FRESH != 0, copies > 1, "moments of what shares a place are cleared");
        assert_eq!(plan.means[k][0], source as f32);
    }
    assert_eq!(planned(&opacities, &config(103)).sources.len(), 103);
    assert_eq!(planned(&opacities, &config(50)).sources.len(), 100, "the cap removes nothing");
    let dead = planned(&[0.001; 4], &config(1000));
    assert_eq!(dead.sources, [0, 1, 2, 3]);
}

#[test]
fn draws_follow_the_opacity() {
    let opacities: Vec<f32> = (0..1000)
        .map(|i| {
            if i == 0 {
                0.99
            } else if i < 500 {
                0.001
            } else {
                0.01
            }
        })
        .collect();
    let plan = planned(&opacities, &config(1000));
    let on_first = plan.sources.iter().filter(|s| *s & !FRESH == 0).count() as f64 - 1.0;
    let expected = 499.0 * 0.99 / (0.99 + 500.0 * 0.01);
    assert!((on_first - expected).abs() < 4.0 * expected.sqrt(), "{on_first} against {expected}");
}

/// The hash, the normal numbers and the step in double precision.
fn noise_twin(i: u32, seed: u32, strength: f64, q: [f32; 4], log_scale: [f32; 3], logit: f32) -> DVec3 {
    let hash = |value: u32| {
        let state = value.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
        (word >> 22) ^ word
    };
    let unit = |bits: u32| (f64::from(bits >> 8) + 0.5) / f64::from(1 << 24);
    let a = hash(i ^ seed);
    let (b, c, d) = (hash(a), hash(hash(a)), hash(hash(hash(a))));
    let turn = |bits: u32| std::f64::consts::TAU * unit(bits);
    let length = |bits: u32| (-2.0 * unit(bits).ln()).sqrt();
    let normal = DVec3::new(length(a) * turn(b).cos(), length(a) * turn(b).sin(), length(c) * turn(d).cos());
    let opacity = 1.0 / (1.0 + (-f64::from(logit)).exp());
    let gain = strength / (1.0 + (100.0 * (opacity - 0.005)).exp());
    let [w, x, y, z] = q.map(f64::from);
    let r = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
    let s = DVec3::from(log_scale.map(|s| f64::from(s).exp()));
    r * (s * s * (r.transpose() * normal)) * gain
}

#[test]
fn noise_follows_the_twin_and_the_covariance() {
    let gpu = gpu();
    let n = 20_000usize;
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut draw = |low: f32, high: f32| rng.random_range(low..high);
    // The second half are all alike, for their statistics.
    let alike = |i: usize| i >= n / 2;
    let same = [0.8f32, 0.1, -0.5, 0.3];
    let rotations: Vec<[f32; 4]> =
        (0..n).map(|i| if alike(i) { same } else { std::array::from_fn(|_| draw(-1.0, 1.0)) }).collect();
    let log_scales: Vec<[f32; 3]> =
        (0..n).map(|i| if alike(i) { [0.0, -0.5, -1.5] } else { std::array::from_fn(|_| draw(-6.0, 0.5)) }).collect();
    let logits: Vec<f32> = (0..n).map(|i| if alike(i) { -9.0 } else { draw(-12.0, 8.0) }).collect();
    let (seed, strength) = (77, 0.25);
    let upload = |what, values: &[f32]| gpu.upload(what, values).unwrap();
    let means = upload("means", &vec![0.0; 3 * n]);
    let buffers = McmcNoiseBindings {
        rotations: &gpu.upload("rotations", &rotations).unwrap(),
        log_scales: &upload("log scales", log_scales.as_flattened()),
        opacity_logits: &upload("logits", &logits),
        means: &means,
    };
    let params = McmcNoiseParams { count: n as u32, seed, strength: strength as f32 };
    let mut pass = Pass::new(&gpu, "test");
    pass.linear(&buffers, &params, n);
    pass.submit();
    let moved = gpu.read(&means.cast::<[f32; 3]>(), n).unwrap();
    let steps: Vec<DVec3> =
        (0..n).map(|i| noise_twin(i as u32, seed, strength, rotations[i], log_scales[i], logits[i])).collect();
    for (i, (ours, twin)) in moved.iter().zip(&steps).enumerate() {
        let error = (DVec3::from(ours.map(f64::from)) - *twin).length();
        assert!(error <= 2e-4 * twin.length() + 1e-7, "Gaussian {i}: {ours:?} against {twin}");
    }
    let r = DMat3::from_quat(DQuat::from_xyzw(0.1, -0.5, 0.3, 0.8).normalize());
    let covariance = r * DMat3::from_diagonal(DVec3::new(0.0f64, -1.0, -3.0).exp()) * r.transpose();
    let gain = strength / (1.0 + (100.0 / (1.0 + 9f64.exp()) - 0.5).exp());
    let expected = covariance * covariance * gain * gain;
    let half = &steps[n / 2..];
    for (row, column) in [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)] {
        let mean = half.iter().map(|s| s[row] * s[column]).sum::<f64>() / half.len() as f64;
        let scale = (expected.col(row)[row] * expected.col(column)[column]).sqrt();
        assert!((mean - expected.col(column)[row]).abs() < 0.06 * scale, "{row} {column}: {mean}, {expected}");
    }
}
