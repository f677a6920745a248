//! Twin of the optimiser step (method.md section 1): Adam with bias correction, and its moments packed.

use ibgs_shaders::{MOMENT1_BITS, MOMENT2_BITS};

/// Settings of one step. The moments' decay rates are `beta1` and `beta2`; `eps` is added after the square root of
/// the bias-corrected second moment.
#[derive(Clone, Copy, Debug)]
pub struct Adam {
    pub learning_rate: f64,
    pub beta1: f64,
    pub beta2: f64,
    pub eps: f64,
    /// Share of a value that is lost in a step, times the learning rate, beside the gradient's step.
    pub decay: f64,
}

impl Adam {
    /// The settings of the Gaussians' tensors.
    pub fn gaussians(learning_rate: f64) -> Adam {
        Adam { learning_rate, beta1: 0.9, beta2: 0.999, eps: 1e-15, decay: 0.0 }
    }

    /// One step in place; `step` counts from 1.
    pub fn step(&self, step: u32, value: &mut [f64], grad: &[f64], m: &mut [f64], v: &mut [f64]) {
        assert!(step > 0, "Adam's step counts from 1");
        let correction1 = 1.0 - self.beta1.powi(step as i32);
        let correction2 = 1.0 - self.beta2.powi(step as i32);
        for i in 0..value.len() {
            m[i] = self.beta1 * m[i] + (1.0 - self.beta1) * grad[i];
            v[i] = self.beta2 * v[i] + (1.0 - self.beta2) * grad[i] * grad[i];
            let kept = (1.0 - self.learning_rate * self.decay) * value[i];
            value[i] = kept - self.learning_rate * (m[i] / correction1) / ((v[i] / correction2).sqrt() + self.eps);
        }
    }
}

/// Bits of a value's code.
const MOMENT_BITS: u32 = MOMENT1_BITS + MOMENT2_BITS;
const MASK: u32 = (1 << MOMENT_BITS) - 1;
/// Largest code of the second moment's root, the binary logarithms of those of code 1 and of the largest, and their distance.
const SCALE_MOST: f64 = ((1u32 << MOMENT2_BITS) - 1) as f64;
const SCALE_FIRST: f64 = -44.0;
const SCALE_STEP: f64 = (4.0 - SCALE_FIRST) / (SCALE_MOST - 1.0);
/// Largest ratio of the first moment to that root, and its steps.
const RATIO_MOST: f64 = 7.3;
const RATIO_STEPS: f64 = ((1u32 << (MOMENT1_BITS - 1)) - 1) as f64;

fn hash(value: u32) -> u32 {
    let state = value.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

/// The 32 random bits of each value in turn that step together: three, or one in rows that three do not divide; `index` counts
/// what steps together.
pub fn random_bits(index: u32, step: u32) -> impl Iterator<Item = u32> {
    std::iter::successors(Some(hash(index ^ hash(step))), |&bits| Some(hash(bits)))
}

/// The codes in the words of rows with `row` values: three in two words, or one in each where three do not divide a row.
pub fn codes_of(words: &[u32], row: u32) -> Vec<u32> {
    if !row.is_multiple_of(3) {
        return words.to_vec();
    }
    let three = |&[a, b]: &[u32; 2]| [a & MASK, b & MASK, a >> MOMENT_BITS | b >> MOMENT_BITS << (32 - MOMENT_BITS)];
    words.as_chunks().0.iter().flat_map(three).collect()
}

/// The words of codes.
pub fn words_of(codes: &[u32], row: u32) -> Vec<u32> {
    if !row.is_multiple_of(3) {
        return codes.to_vec();
    }
    let two = |&[a, b, c]: &[u32; 3]| [a | c << MOMENT_BITS, b | c >> (32 - MOMENT_BITS) << MOMENT_BITS];
    codes.as_chunks().0.iter().flat_map(two).collect()
}

/// Of 16 bits, between 0 and 1.
fn unit(bits: u32) -> f64 {
    (f64::from(bits & 0xffff) + 0.5) / 65536.0
}

/// First and second moment of a code.
pub fn unpack(code: u32) -> [f64; 2] {
    let scale = match code & ((1 << MOMENT2_BITS) - 1) {
        0 => 0.0,
        code => (SCALE_FIRST + (f64::from(code) - 1.0) * SCALE_STEP).exp2(),
    };
    // The sign of the ratio comes from its top bit.
    let steps = f64::from((code << (32 - MOMENT_BITS)) as i32 >> (32 - MOMENT1_BITS)) / RATIO_STEPS;
    [RATIO_MOST * steps * steps.abs() * scale, scale * scale]
}

/// A rounding: the code below, and the part of the way to the next.
#[derive(Clone, Copy, Debug)]
pub struct Rounding {
    pub below: f64,
    pub part: f64,
}

impl Rounding {
    fn rounded(self, bits: u32) -> f64 {
        self.below + if unit(bits) < self.part { 1.0 } else { 0.0 }
    }
}

/// How the second moment is rounded.
pub fn scale_rounding(second: f64) -> Rounding {
    let square = |code: f64| (2.0 * (SCALE_FIRST + (code - 1.0) * SCALE_STEP)).exp2();
    if second < square(1.0) {
        return Rounding { below: 0.0, part: second / square(1.0) };
    }
    let below = (1.0 + ((second.sqrt().log2() - SCALE_FIRST) / SCALE_STEP).floor()).min(SCALE_MOST - 1.0);
    Rounding { below, part: (second - square(below)) / (square(below + 1.0) - square(below)) }
}

/// How the first moment's size is rounded beside the code of the second.
pub fn ratio_rounding(first: f64, scale_code: f64) -> Rounding {
    let scale = (SCALE_FIRST + (scale_code - 1.0) * SCALE_STEP).exp2();
    let squared = (first.abs() / scale / RATIO_MOST).min(1.0) * RATIO_STEPS * RATIO_STEPS;
    let below = squared.sqrt().floor().min(RATIO_STEPS - 1.0);
    Rounding { below, part: (squared - below * below) / (2.0 * below + 1.0) }
}

/// The code of first and second moment, rounded by 32 random bits.
pub fn pack([first, second]: [f64; 2], bits: u32) -> u32 {
    let scale_code = scale_rounding(second).rounded(bits);
    if scale_code == 0.0 {
        return 0;
    }
    let steps = ratio_rounding(first, scale_code).rounded(bits >> 16) as i32;
    let signed = (if first < 0.0 { -steps } else { steps }) as u32;
    scale_code as u32 | (signed << MOMENT2_BITS) & MASK
}
