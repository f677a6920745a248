//! Weights of the residual network at the start of a training.

use super::{GATE, tensors};
use crate::residual::layers::{COLORS, CONFIDENCE, FINAL, FUSE, INPUT, Layer, MLP1, MLP2, WEIGHTS};
use crate::residual::variant::{Output, Variant};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Bias of a source's confidence at the start: three sources then have 0.96 of the weight.
const TRUSTING: f32 = 2.0;

/// Weight of the depth's error, as a part of what agrees, at the start: a source whose depth is off by four times that counts little.
const BY_ERROR: f32 = -1.0;

/// Share of the sources' mean colour difference that the residual has at the start.
const PASSED: f32 = 0.5;

/// Part of their usual size that the other weights of the last layer have at the start, where the differences are passed.
const QUIET: f32 = 0.1;

/// Initial weights of a variant: those of [`random`], and where the network gives a residual alone, it is half of the sources' mean difference at first; where it gives a gate of that difference, the gate is
/// half open. Without that, a run of some hundred iterations ends before the network has learned to pass anything. A departure from
/// method.md.
pub fn initial(variant: &Variant, seed: u64) -> Vec<f32> {
    let mut weights = random(seed);
    match variant.output {
        Output::Residual => pass_differences(&mut weights),
        // The sigmoid of zero is a half.
        Output::Gated => weights[FINAL.offset..FINAL.end()].iter_mut().for_each(|weight| *weight *= QUIET),
    }
    weights
}

/// Sets the channels that carry the differences. Channels have no sign behind a ReLU, so each colour has two: its positive part
/// and its negative one.
fn pass_differences(weights: &mut [f32]) {
    let mut only = |layer: &Layer, output: usize, input: usize, weight: f32| {
        let row = layer.offset + output * layer.row();
        weights[row..row + layer.row()].fill(0.0);
        weights[row + input] = weight;
        weights[layer.bias() + output] = 0.0;
    };
    for color in 0..COLORS {
        for (channel, sign) in [(color, 1.0), (color + 3, -1.0)] {
            only(&MLP1, channel, color, sign);
            only(&MLP2, channel, channel, 1.0);
            // Its inputs are those of the decoder and then the network's own.
            only(&FUSE, channel, INPUT + channel, 1.0);
        }
    }
    for color in 0..COLORS {
        let row = FINAL.offset + color * FINAL.row();
        weights[row..row + 6].fill(0.0);
        weights[row + 6..row + FINAL.row()].iter_mut().for_each(|weight| *weight *= QUIET);
        (weights[row + color], weights[row + color + 3]) = (PASSED, -PASSED);
        weights[FINAL.bias() + color] = 0.0;
    }
}

/// Random weights and biases: uniform in +-1/sqrt(fan in) of their layer (method.md section 6), but the two of the
/// confidence above and those of the gate, which are zero. The same seed gives the same ones on every machine.
pub fn random(seed: u64) -> Vec<f32> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut weights = vec![0.0; WEIGHTS];
    for tensor in tensors().into_iter().filter(|tensor| !tensor.name.starts_with(GATE)) {
        let bound = 1.0 / ((tensor.layer.inputs * tensor.layer.taps) as f32).sqrt();
        weights[tensor.first..tensor.first + tensor.len()].fill_with(|| rng.random_range(-bound..=bound));
    }
    weights[CONFIDENCE.bias() - 1] = BY_ERROR;
    weights[CONFIDENCE.bias()] = TRUSTING;
    weights
}

#[cfg(test)]
mod tests {
    use super::super::Named;
    use super::*;
    use crate::residual::layers::LAYERS;

    #[test]
    fn initial_values_stay_within_their_bounds() {
        let weights = random(7);
        assert_eq!(weights.len(), WEIGHTS);
        assert_eq!(weights, random(7));
        assert_ne!(weights, random(8));
        assert_eq!(weights[CONFIDENCE.bias()], TRUSTING);
        for Named { name, shape, first, layer, ours } in tensors() {
            let own = &weights[first..first + shape.iter().product::<usize>()];
            if ours {
                assert!(layer == CONFIDENCE || own.iter().all(|w| *w == 0.0), "{name}");
                continue;
            }
            let bound = 1.0 / ((layer.inputs * layer.taps) as f32).sqrt();
            let largest = own.iter().fold(0f32, |a, w| a.max(w.abs()));
            assert!(largest <= bound && largest > 0.0, "{name}: {largest} of {bound}");
            if name.ends_with("weight") {
                let square = own.iter().map(|w| w * w).sum::<f32>() / own.len() as f32;
                assert!(largest > 0.9 * bound && (square / (bound * bound / 3.0) - 1.0).abs() < 0.25, "{name}");
            }
        }
    }

    #[test]
    fn a_residual_passes_the_differences_at_first() {
        let of = |output| initial(&Variant { output, ..Variant::default() }, 5);
        let (gated, random) = (of(Output::Gated), random(5));
        assert_eq!(gated[..FINAL.offset], random[..FINAL.offset]);
        assert_eq!(gated[FINAL.offset], QUIET * random[FINAL.offset]);
        let passing = of(Output::Residual);
        let changed = |layer: &Layer| (layer.offset..layer.end()).any(|i| passing[i] != random[i]);
        let layers: Vec<&str> = LAYERS.iter().filter(|layer| changed(layer)).map(|layer| layer.name).collect();
        assert_eq!(layers, [MLP1.name, MLP2.name, FUSE.name, FINAL.name]);
    }
}
