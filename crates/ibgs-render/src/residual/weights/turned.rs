//! A network for a scene that is turned.

use crate::residual::layers::{ENC1, FUSE, HIDDEN, INPUT, Layer, MLP1};
use glam::{DMat3, DVec3};

/// The layers that read a vector in the scene's axes, and its first input: the source's place as seen from the camera, and twice
/// the viewing ray.
const READERS: [(Layer, usize); 3] = [(MLP1, 3), (ENC1, HIDDEN), (FUSE, INPUT + HIDDEN)];

/// Flat weights of the network that computes in the turned scene what these compute in the scene (method.md sections 5 and 6): a
/// layer is linear, so its weights turn as the vectors do that it reads.
///
/// # Panics
/// Another number of weights: a bug of ours.
#[must_use]
pub fn turned(weights: &[f32], rotation: DMat3) -> Vec<f32> {
    let mut weights = weights.to_vec();
    for (layer, first) in READERS {
        for output in 0..layer.outputs {
            for tap in 0..layer.taps {
                let at = |axis: usize| layer.offset + output * layer.row() + (first + axis) * layer.taps + tap;
                let turned = rotation * DVec3::from([0, 1, 2].map(|axis| f64::from(weights[at(axis)])));
                turned.to_array().into_iter().enumerate().for_each(|(axis, value)| weights[at(axis)] = value as f32);
            }
        }
    }
    weights
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::residual::weights::random;

    #[test]
    fn a_layer_reads_turned_vectors_as_it_read_them_before() {
        let rotation = DMat3::from_rotation_y(0.7) * DMat3::from_rotation_x(2.0);
        let before = random(5);
        let after = turned(&before, rotation);
        let vector = DVec3::new(0.3, -2.0, 1.1);
        for (layer, first) in READERS {
            let sum = |weights: &[f32], vector: DVec3, output: usize, tap: usize| {
                let row = &weights[layer.offset + output * layer.row()..][..layer.row()];
                (0..3).map(|axis| f64::from(row[(first + axis) * layer.taps + tap]) * vector[axis]).sum::<f64>()
            };
            for (output, tap) in [(0, 0), (layer.outputs - 1, layer.taps - 1)] {
                let [from, to] = [(&before, vector), (&after, rotation * vector)];
                let [from, to] = [from, to].map(|(weights, vector)| sum(weights, vector, output, tap));
                assert!((from - to).abs() < 1e-6, "{}: {from} {to}", layer.name);
            }
        }
        let changed = before.iter().zip(&after).filter(|(a, b)| a != b).count();
        assert_eq!(changed, READERS.iter().map(|(layer, _)| 3 * layer.outputs * layer.taps).sum::<usize>());
        assert_eq!(turned(&before, DMat3::IDENTITY), before);
    }
}
