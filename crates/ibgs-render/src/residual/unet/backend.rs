//! What a backend of the U-Net does for each step of the schedule, and what both backends share.

use super::memory::{Activations, Gradients, Map};
use crate::gpu::{Buffer, Pass};
use crate::residual::layers::{Layer, Part};
use ibgs_shaders::{ConvInput, Store};
use std::ops::Range;

/// Workgroups that share `tiles` tiles: at most `most`, each with at least `fewest`.
pub(super) fn splits(tiles: u32, fewest: u32, most: u32) -> u32 {
    tiles.div_ceil(fewest).min(most)
}

/// How a convolution of size `size` reads an input of size `source`.
pub(super) fn conv_input(source: [u32; 2], size: [u32; 2]) -> ConvInput {
    match source[0].cmp(&size[0]) {
        std::cmp::Ordering::Equal => ConvInput::Same,
        std::cmp::Ordering::Greater => ConvInput::Pooled,
        std::cmp::Ordering::Less => ConvInput::Nearest,
    }
}

/// What a backward pass reads and writes.
#[derive(Clone, Copy)]
pub(super) struct BackwardBuffers<'a> {
    pub maps: &'a Activations,
    pub gradients: &'a Gradients,
    /// The network's flat weights.
    pub weights: &'a Buffer<f32>,
    /// Gradient by the output, `[height * width, 4]`.
    pub v_residual: &'a Buffer<[f32; 4]>,
    /// Gradient by the flat weights.
    pub v_weights: &'a Buffer<f32>,
}

/// The operations of the U-Net's layers in one arithmetic. Each records its kernels into the pass.
pub(super) trait Backend: std::fmt::Debug + Send + Sync {
    /// Before the first layer: brings the weights into the order in which the forward pass reads them.
    fn prepare(&self, _pass: &mut Pass, _weights: &Buffer<f32>) {}

    /// A 3 x 3 layer over one or two activations (two: their concatenation), with ReLU. A larger activation is read
    /// through the 2 x 2 maximum, a smaller one through the enlargement by nearest.
    fn conv(&self, pass: &mut Pass, weights: &Buffer<f32>, layer: &Layer, inputs: &[&Map], output: &Map);

    /// The last two layers: from d1 and x to the output, and to f where it is kept.
    fn head(&self, pass: &mut Pass, weights: &Buffer<f32>, maps: &Activations);

    /// First of the backward pass, back through the last two layers: their weight gradients, then d1 becomes its
    /// gradient, and f their part of the gradient by x. Until then v_e1 is free for other values.
    fn head_backward(&self, pass: &mut Pass, buffers: &BackwardBuffers);

    /// Gradient by the weights of a part of a layer's inputs, and with the first part by its biases. `v` is the gradient
    /// by the layer's output.
    fn weight_gradient(&self, pass: &mut Pass, buffers: &BackwardBuffers, part: Part, v: &Map, input: &Map);

    /// Gradient by a part of a 3 x 3 layer's inputs, at the layer's size.
    fn input_gradient(&self, pass: &mut Pass, weights: &Buffer<f32>, part: Part, v: &Map, v_input: &Map, store: Store);

    /// Through the 2 x 2 maximum and the ReLU of `activation`: completes and masks its gradient `v`.
    fn pool_backward(&self, pass: &mut Pass, activation: &Map, v_pooled: &Map, v: &Map);

    /// Through the enlargement and the ReLU: the gradient takes the place of the activation `v`.
    fn upsample_backward(&self, pass: &mut Pass, v_enlarged: &Map, v: &Map);

    /// Last of the backward pass: channels `channels` of the gradient by x, which f holds by now, to float32 planes;
    /// nothing where f has such planes itself.
    fn finish(&self, _pass: &mut Pass, _f: &Map, _channels: Range<usize>, _planes: &Buffer<f32>) {}

    /// Whether its matrix units fit the kernels of the per-view MLP.
    fn multiplies_features(&self) -> bool {
        false
    }

    /// Inverse of the scale of the gradient by x in half precision, where kernels can read that as it is.
    fn unscale(&self) -> Option<f32> {
        None
    }

    /// Partial sums that any layer's weight gradient takes at most, for images of `size` pixels.
    fn partials(&self, size: [u32; 2]) -> usize;
}
