//! Adam against its twin, with full moments and packed.

use glam::DVec3;
use ibgs_core::gpu::{Buffer, Gpu, Pass};
use ibgs_reference::adam::{
    Adam, Rounding, codes_of, pack, random_bits, ratio_rounding, scale_rounding, unpack, words_of,
};
use ibgs_reference::gpu::gpu;
use ibgs_reference::sh;
use ibgs_shaders::bindings::{AdamBindings, AdamHarmonicsBindings, AdamPackedBindings, AdamPackedHarmonicsBindings};
use ibgs_shaders::types::AdamParams;
use ibgs_shaders::{MOMENT1_BITS, MOMENT2_BITS};
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

const RATES: [f64; 2] = [2.5e-3, 1.25e-4];
/// Values of a row, an odd number, and those with the first rate.
const ROW: u32 = 27;
const HEAD: u32 = 3;

fn params(count: usize, step: i32, decay: f64) -> AdamParams {
    AdamParams {
        count: count as u32,
        row: ROW,
        head: HEAD,
        rate: RATES[0] as f32,
        rate_rest: RATES[1] as f32,
        beta1: 0.9,
        beta2: 0.999,
        eps: 1e-15,
        correction1: (1.0 / (1.0 - 0.9f64.powi(step))) as f32,
        correction2: (1.0 / (1.0 - 0.999f64.powi(step))) as f32,
        decay_rest: decay as f32,
        step: step as u32,
        center: [0.0; 3],
        sh_degree: 0,
    }
}

/// Gradients over many orders of magnitude, zero among them.
fn gradient(n: usize, rng: &mut ChaCha8Rng) -> Vec<f32> {
    (0..n)
        .map(|i| if i % 7 == 0 { 0.0 } else { rng.random_range(-1.0..1.0f32) * 10f32.powi(-(i as i32 % 12)) })
        .collect()
}

/// The twin of value `i` of all rows.
fn twin_of(i: usize, row: u32, decay: f64) -> Adam {
    let is_rest = i as u32 % row >= HEAD;
    Adam { decay: if is_rest { decay } else { 0.0 }, ..Adam::gaussians(RATES[usize::from(is_rest)]) }
}

fn follows_the_twin(decay: f64) {
    let gpu = gpu();
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let n = 5 * ROW as usize;
    let start: Vec<f32> = (0..n).map(|_| rng.random_range(-1.0..1.0)).collect();
    let mut twin: Vec<f64> = start.iter().copied().map(f64::from).collect();
    let (mut m, mut v) = (vec![0.0; n], vec![0.0; n]);
    let values = gpu.upload("values", &start).unwrap();
    let moments = [gpu.allocate("m", n).unwrap(), gpu.allocate("v", n).unwrap()];
    for step in 1..=20i32 {
        let gradient = gradient(n, &mut rng);
        let input = gpu.upload("gradient", &gradient).unwrap();
        let mut pass = Pass::new(&gpu, "test");
        let [moment1, moment2] = &moments;
        pass.linear(&AdamBindings { gradient: &input, values: &values, moment1, moment2 }, &params(n, step, decay), n);
        pass.submit();
        for i in 0..n {
            let at = i..i + 1;
            let gradient = [f64::from(gradient[i])];
            twin_of(i, ROW, decay).step(step as u32, &mut twin[at.clone()], &gradient, &mut m[at.clone()], &mut v[at]);
        }
    }
    let ours = gpu.read(&values, n).unwrap();
    for (i, (a, b)) in ours.iter().zip(&twin).enumerate() {
        let moved = (f64::from(start[i]) - b).abs();
        let error = (f64::from(*a) - b).abs();
        assert!(error <= 1e-5 * moved + 3e-7, "value {i}: {a} against {b}, moved {moved:e}");
        if i % 7 != 0 {
            assert!(moved > 0.0, "value {i} must move");
        } else if i as u32 % ROW >= HEAD {
            let kept = (1.0 - RATES[1] * decay).powi(20);
            assert!((b - kept * f64::from(start[i])).abs() < 1e-12, "value {i} has no gradient and only decays");
        }
    }
}

/// Every step begins with the moments that the kernel left, so that one other rounding does not change all that follows.
fn packed_follows_the_twin(row: u32) {
    let gpu = gpu();
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let (rows, decay) = (40, 8.0);
    let n = rows * row as usize;
    let together = if row.is_multiple_of(3) { 3 } else { 1 };
    let start: Vec<f32> = (0..n).map(|_| rng.random_range(-1.0..1.0)).collect();
    let values = gpu.upload("values", &start).unwrap();
    let moments = gpu.allocate("moments", words_of(&vec![0; n], row).len()).unwrap();
    let (mut codes, mut close, mut kept) = (0, 0, vec![0u32; n]);
    for step in 1..=30 {
        let gradient = gradient(n, &mut rng);
        let before = gpu.read(&values, n).unwrap();
        let mut pass = Pass::new(&gpu, "test");
        let buffers = AdamPackedBindings {
            gradient: &gpu.upload("gradient", &gradient).unwrap(),
            values: &values,
            moments: &moments,
        };
        pass.linear(&buffers, &AdamParams { row, ..params(n, step, decay) }, n / together);
        pass.submit();
        let after = gpu.read(&values, n).unwrap();
        let next = codes_of(&gpu.read(&moments, moments.rows()).unwrap(), row);
        for i in 0..n {
            let [mut m, mut v] = unpack(kept[i]);
            let mut value = f64::from(before[i]);
            let each = std::slice::from_mut;
            let twin = twin_of(i, row, decay);
            twin.step(step as u32, each(&mut value), &[gradient[i].into()], each(&mut m), each(&mut v));
            let (moved, error) = ((value - f64::from(before[i])).abs(), (value - f64::from(after[i])).abs());
            assert!(
                error <= 3e-5 * moved + 1e-7,
                "step {step}, value {i}: {} against {value}, moved {moved:e}",
                after[i]
            );
            let bits = random_bits((i / together) as u32, step as u32).nth(i % together).unwrap();
            codes += 1;
            match unpack(next[i]) == unpack(pack([m, v], bits)) {
                true => {}
                false if is_close([m, v], bits) => close += 1,
                false => panic!("step {step}, value {i}: {m:e} and {v:e} became {:?}", unpack(next[i])),
            }
        }
        // The unused part of words stays empty.
        assert!(next.iter().all(|code| code >> (MOMENT1_BITS + MOMENT2_BITS) == 0));
        kept = next;
    }
    assert!(50 * close < codes, "{close} of {codes} are rounded otherwise");
    assert!(kept.iter().any(|code| code & ((1 << MOMENT2_BITS) - 1) > 1));
}

#[test]
fn packed_steps_follow_the_twin() {
    packed_follows_the_twin(ROW);
}

/// Rows that three do not divide have a word for each value.
#[test]
fn packed_steps_of_single_words_follow_the_twin() {
    packed_follows_the_twin(4);
}

/// Whether float32 may round these moments otherwise: a random number lies close to a threshold, or a code's step to the next.
fn is_close([m, v]: [f64; 2], bits: u32) -> bool {
    let near = |Rounding { part, .. }: Rounding, bits: u32, slack: f64| {
        let random = (f64::from(bits & 0xffff) + 0.5) / 65536.0;
        (random - part).abs() < slack || !(slack..1.0 - slack).contains(&part)
    };
    // The logarithm, up to 44, is exact to 4e-6, the ratio to 1e-6; the finer the steps, the larger a part of one that is.
    let slack = [MOMENT2_BITS, MOMENT1_BITS].map(|bits| 2e-3 + 2e-6 * f64::from(1u32 << bits));
    let second = scale_rounding(v);
    let first = |code: f64| code > 0.0 && near(ratio_rounding(m, code), bits >> 16, slack[1]);
    near(second, bits, slack[0]) || first(second.below) || first(second.below + 1.0)
}

/// Gaussians with `stored` degrees of spherical harmonics, of which `active` count, and gradients by their colours, some of them zero.
struct Colours {
    means: Vec<[f32; 3]>,
    v_colors: Vec<f32>,
    params: AdamParams,
    /// By the coefficients.
    gradient: Vec<f64>,
}

impl Colours {
    fn new(stored: u32, active: u32) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(u64::from(stored));
        let (n, row) = (300, 3 * (stored + 1).pow(2));
        let center = [0.3f32, -0.2, 0.5];
        let means: Vec<[f32; 3]> = (0..n).map(|_| std::array::from_fn(|_| rng.random_range(-2.0..2.0))).collect();
        let v_colors = (0..3 * n).map(|i| if i / 3 % 5 == 0 { 0.0 } else { rng.random_range(-1.0..1.0f32) });
        let v_colors: Vec<f32> = v_colors.collect();
        let point = |p: [f32; 3]| DVec3::from(p.map(f64::from));
        let coefficient = |i: usize| {
            let (g, k, channel) = (i / row as usize, i % row as usize / 3, i % 3);
            let basis = sh::basis((point(means[g]) - point(center)).normalize())[k];
            if k < (active as usize + 1).pow(2) { basis * f64::from(v_colors[3 * g + channel]) } else { 0.0 }
        };
        let gradient = (0..n * row as usize).map(coefficient).collect();
        let usual = params(n * row as usize, 7, 3.0);
        Self { means, v_colors, params: AdamParams { row, center, sh_degree: active, ..usual }, gradient }
    }

    /// Whether the values followed the twin from there, with these moments before.
    fn check(&self, before: &[f32], after: &[f32], moments: impl Fn(usize) -> [f64; 2]) {
        for i in 0..before.len() {
            let [mut m, mut v] = moments(i);
            let mut value = f64::from(before[i]);
            let is_rest = i as u32 % self.params.row >= HEAD;
            let decay = if is_rest { 3.0 } else { 0.0 };
            let adam = Adam { decay, ..Adam::gaussians(RATES[usize::from(is_rest)]) };
            let each = std::slice::from_mut;
            adam.step(7, each(&mut value), &[self.gradient[i]], each(&mut m), each(&mut v));
            let (moved, error) = ((value - f64::from(before[i])).abs(), (value - f64::from(after[i])).abs());
            assert!(error <= 1e-4 * moved + 1e-6, "value {i}: {} against {value}, moved {moved:e}", after[i]);
        }
    }
}

fn random_values(gpu: &Gpu, n: usize, least: f32) -> (Vec<f32>, Buffer<f32>) {
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let values: Vec<f32> = (0..n).map(|_| rng.random_range(least..1.0)).collect();
    let buffer = gpu.upload("values", &values).unwrap();
    (values, buffer)
}

#[test]
fn coefficients_step_by_the_gradient_of_the_colour() {
    let gpu = gpu();
    for (stored, active) in [(0, 0), (1, 0), (2, 2), (3, 1), (3, 3)] {
        let colours = Colours::new(stored, active);
        let (n, row) = (colours.gradient.len(), colours.params.row);
        let gradient = &gpu.upload("gradient", &colours.v_colors).unwrap();
        let means = &gpu.upload("means", colours.means.as_flattened()).unwrap();
        let ((before, values), (m, moment1), (v, moment2)) =
            (random_values(&gpu, n, -1.0), random_values(&gpu, n, -1.0), random_values(&gpu, n, 0.1));
        let mut pass = Pass::new(&gpu, "test");
        let (moment1, moment2) = (&moment1, &moment2);
        let buffers = AdamHarmonicsBindings { gradient, values: &values, moment1, moment2, means };
        pass.linear(&buffers, &colours.params, n);
        pass.submit();
        colours.check(&before, &gpu.read(&values, n).unwrap(), |i| [m[i].into(), v[i].into()]);

        let codes = random_codes(n);
        let (start, values) = random_values(&gpu, n, -1.0);
        let moments = &gpu.upload("moments", &words_of(&codes, row)).unwrap();
        let mut pass = Pass::new(&gpu, "test");
        let buffers = AdamPackedHarmonicsBindings { gradient, values: &values, moments, means };
        pass.linear(&buffers, &colours.params, n / 3);
        pass.submit();
        colours.check(&start, &gpu.read(&values, n).unwrap(), |i| unpack(codes[i]));
    }
}

/// Codes of moments of middling size.
fn random_codes(n: usize) -> Vec<u32> {
    let mut rng = ChaCha8Rng::seed_from_u64(10);
    (0..n).map(|_| pack([rng.random_range(-1e-2..1e-2), rng.random_range(1e-6..1e-2)], rng.random())).collect()
}
