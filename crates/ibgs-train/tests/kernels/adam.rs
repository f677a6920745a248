//! Adam against its twin.

use ibgs_core::gpu::Pass;
use ibgs_reference::adam::Adam;
use ibgs_reference::gpu::gpu;
use ibgs_shaders::bindings::AdamBindings;
use ibgs_shaders::types::AdamParams;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

#[test]
fn twenty_steps_follow_the_twin() {
    follows_the_twin(0.0);
}

/// Each step takes a thousandth of the rest of a row away.
#[test]
fn the_rest_of_a_row_decays() {
    follows_the_twin(8.0);
}

fn follows_the_twin(decay: f64) {
    let gpu = gpu();
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let (n, row, head) = (5 * 27, 27, 3);
    let start: Vec<f32> = (0..n).map(|_| rng.random_range(-1.0..1.0)).collect();
    let mut twin: Vec<f64> = start.iter().copied().map(f64::from).collect();
    let (mut m, mut v) = (vec![0.0; n], vec![0.0; n]);
    let values = gpu.upload("values", &start).unwrap();
    let moments = [gpu.allocate("m", n).unwrap(), gpu.allocate("v", n).unwrap()];
    let rates = [2.5e-3, 1.25e-4];
    for step in 1..=20i32 {
        // Gradients over many orders of magnitude, zero among them.
        let gradient: Vec<f32> = (0..n)
            .map(|i| if i % 7 == 0 { 0.0 } else { rng.random_range(-1.0..1.0f32) * 10f32.powi(-(i as i32 % 12)) })
            .collect();
        let params = AdamParams {
            count: n as u32,
            row,
            head,
            rate: rates[0] as f32,
            rate_rest: rates[1] as f32,
            beta1: 0.9,
            beta2: 0.999,
            eps: 1e-15,
            correction1: (1.0 / (1.0 - 0.9f64.powi(step))) as f32,
            correction2: (1.0 / (1.0 - 0.999f64.powi(step))) as f32,
            decay_rest: decay as f32,
        };
        let input = gpu.upload("gradient", &gradient).unwrap();
        let mut pass = Pass::new(&gpu, "test");
        let [moment1, moment2] = &moments;
        pass.linear(&AdamBindings { gradient: &input, values: &values, moment1, moment2 }, &params, n);
        pass.submit();
        for i in 0..n {
            let is_rest = i as u32 % row >= head;
            let adam =
                Adam { decay: if is_rest { decay } else { 0.0 }, ..Adam::gaussians(rates[usize::from(is_rest)]) };
            let at = i..i + 1;
            let gradient = [f64::from(gradient[i])];
            adam.step(step as u32, &mut twin[at.clone()], &gradient, &mut m[at.clone()], &mut v[at]);
        }
    }
    let ours = gpu.read(&values, n).unwrap();
    for (i, (a, b)) in ours.iter().zip(&twin).enumerate() {
        let moved = (f64::from(start[i]) - b).abs();
        let error = (f64::from(*a) - b).abs();
        assert!(error <= 1e-5 * moved + 3e-7, "value {i}: {a} against {b}, moved {moved:e}");
        if i % 7 != 0 {
            assert!(moved > 0.0, "value {i} must move");
        } else if i as u32 % row >= head {
            let kept = (1.0 - rates[1] * decay).powi(20);
            assert!((b - kept * f64::from(start[i])).abs() < 1e-12, "value {i} has no gradient and only decays");
        }
    }
}
