//! From the gradient by the residual to those by x and by the weights.

use super::{Buffer, HEAD_PIXELS, INPUT, Map, Mode, Store, Training, UNet, conv_grid};
use crate::gpu::Pass;
use crate::residual::layers::{self, HALF, Layer, QUARTER};
use bytemuck::bytes_of;
use ibgs_shaders::types::{ConvParams, ConvWeightsParams, PoolParams, SumParams, UpsampleParams};
use ibgs_shaders::{
    RESIDUAL_CONV, RESIDUAL_CONV_WEIGHTS, RESIDUAL_HEAD_BACKWARD, RESIDUAL_HEAD_WEIGHTS, RESIDUAL_POOL_BACKWARD,
    RESIDUAL_SUM, RESIDUAL_UPSAMPLE_BACKWARD,
};

/// Most workgroups that share the sums of one layer's weight gradient: two for each of a large GPU's 132 multiprocessors.
const MAX_SPLITS: u32 = 264;
/// Fewest tiles for a workgroup of its own.
const MIN_TILES: u32 = 8;
/// Values of the longest row of partial sums: 38 x 38 x 9 weights and 38 biases.
const LONGEST_ROW: u64 = (9 * INPUT * INPUT + INPUT) as u64;

/// Workgroups that share `tiles` tiles.
fn splits(tiles: u32) -> u32 {
    tiles.div_ceil(MIN_TILES).min(MAX_SPLITS)
}

/// Tiles of 16 x 2 pixels, those of `residual_conv_weights`.
fn conv_tiles(size: [u32; 2]) -> u32 {
    size[0].div_ceil(16) * size[1].div_ceil(2)
}

/// Memory for the partial sums.
pub(super) fn partial_bytes(size: [u32; 2]) -> u64 {
    // The head has twice as many rows a quarter as long, and its blocks of 32 pixels are no more than the tiles.
    4 * LONGEST_ROW * u64::from(splits(conv_tiles(size)))
}

/// Gradient by the inputs `first..first + target.channels` of a layer, at the layer's size.
fn conv_backward(
    pass: &mut Pass,
    weights: &Buffer,
    (layer, first): (&Layer, usize),
    v: &Map,
    target: &Map,
    store: Store,
) {
    assert_eq!((v.channels as usize, v.size), (layer.outputs, target.size), "{}: gradient", layer.name);
    let (grid, groups) = conv_grid(v.size, target.channels);
    let params = ConvParams {
        size: v.size,
        source: v.size,
        mode: Mode::Same as u32,
        channels_a: v.channels,
        channels_b: 0,
        outputs: target.channels,
        weights: (layer.offset + 9 * first) as u32,
        stride_out: 9,
        stride_in: 9 * layer.inputs as u32,
        turned: 1,
        bias: 0,
        store: store as u32,
        groups,
        pad: 0,
    };
    let buffers = [weights, &v.buffer, &v.buffer, &target.buffer];
    pass.grid(&RESIDUAL_CONV, &buffers, bytes_of(&params), grid);
}

/// Through the 2 x 2 maximum and the ReLU of `activation`: completes and masks its gradient `v`.
fn pool_backward(pass: &mut Pass, activation: &Map, v_pooled: &Map, v: &Map) {
    let params = PoolParams { size: v.size, channels: v.channels, pad: 0 };
    let buffers = [&activation.buffer, &v_pooled.buffer, &v.buffer];
    pass.linear(&RESIDUAL_POOL_BACKWARD, &buffers, bytes_of(&params), v.channels as usize * v.pixels());
}

/// Through the enlargement: the gradient takes the place of the activation `v`.
fn upsample_backward(pass: &mut Pass, v_enlarged: &Map, v: &Map) {
    let params = UpsampleParams { size: v_enlarged.size, source: v.size, channels: v.channels, pad: 0 };
    let buffers = [&v_enlarged.buffer, &v.buffer];
    pass.linear(&RESIDUAL_UPSAMPLE_BACKWARD, &buffers, bytes_of(&params), v.channels as usize * v.pixels());
}

impl UNet {
    /// From `v_residual`, `[height * width * 3]`, to [`UNet::v_x`] and the U-Net's part of `v_weights` (from the
    /// first weight of e1 to the end), which is assigned; the rest of `v_weights` is left alone.
    ///
    /// Consumes what the last [`UNet::forward`] kept (gradients replace activations): one backward for each forward,
    /// with the same weights. x and the residual stay.
    ///
    /// # Panics
    /// When made without gradients: a bug of ours.
    pub fn backward(&self, pass: &mut Pass, weights: &Buffer, v_residual: &Buffer, v_weights: &Buffer) {
        let training = self.training.as_ref().expect("an unet made with gradients");
        let Self { x, e1, e2, b, u2, d2, u1, d1, kept, .. } = self;
        let (v_e1, v_e2) = (&training.v_e1, &training.v_e2);
        self.head_backward(pass, weights, v_residual, v_weights);
        let by_weights = |pass: &mut Pass, layer: &Layer, first: usize, v: &Map, input: &Map| {
            self.weight_gradient(pass, (layer, first), v, input, v_weights);
        };
        let by_input = |pass: &mut Pass, layer: &Layer, first: usize, v: &Map, target: &Map, store: Store| {
            conv_backward(pass, weights, (layer, first), v, target, store);
        };
        // From here on d1 holds its gradient, and below u1, d2, u2 and b come to hold theirs in turn.
        by_weights(pass, &layers::DEC1, 0, d1, u1);
        by_weights(pass, &layers::DEC1, INPUT, d1, e1);
        by_input(pass, &layers::DEC1, INPUT, d1, v_e1, Store::Assign);
        by_input(pass, &layers::DEC1, 0, d1, u1, Store::Mask);
        // d1's memory is free for gradients behind an enlargement or a maximum.
        let scratch = |channels, size| d1.reuse(channels, size, 0);
        by_weights(pass, &layers::UP1, 0, u1, d2);
        let v_enlarged = scratch(HALF, u1.size);
        by_input(pass, &layers::UP1, 0, u1, &v_enlarged, Store::Assign);
        upsample_backward(pass, &v_enlarged, d2);
        by_weights(pass, &layers::DEC2, 0, d2, u2);
        by_weights(pass, &layers::DEC2, HALF, d2, e2);
        by_input(pass, &layers::DEC2, HALF, d2, v_e2, Store::Assign);
        by_input(pass, &layers::DEC2, 0, d2, u2, Store::Mask);
        by_weights(pass, &layers::UP2, 0, u2, b);
        let v_enlarged = scratch(QUARTER, u2.size);
        by_input(pass, &layers::UP2, 0, u2, &v_enlarged, Store::Assign);
        upsample_backward(pass, &v_enlarged, b);
        by_weights(pass, &layers::ENC3, 0, b, e2);
        let v_pooled = scratch(HALF, b.size);
        by_input(pass, &layers::ENC3, 0, b, &v_pooled, Store::Assign);
        pool_backward(pass, e2, &v_pooled, v_e2);
        by_weights(pass, &layers::ENC2, 0, v_e2, e1);
        let v_pooled = scratch(INPUT, e2.size);
        by_input(pass, &layers::ENC2, 0, v_e2, &v_pooled, Store::Assign);
        pool_backward(pass, e1, &v_pooled, v_e1);
        by_weights(pass, &layers::ENC1, 0, v_e1, x);
        by_input(pass, &layers::ENC1, 0, v_e1, kept, Store::Add);
    }

    /// The gradient by x after [`UNet::backward`], `[38][height * width]`.
    pub fn v_x(&self) -> &Buffer {
        &self.kept.buffer
    }

    /// The last two layers: their weight gradients, then d1 becomes v_d1 and f becomes their part of v_x.
    fn head_backward(&self, pass: &mut Pass, weights: &Buffer, v_residual: &Buffer, v_weights: &Buffer) {
        let Some(Training { partials, .. }) = &self.training else { return };
        let params = self.head_params();
        let (d1, x, f) = (&self.d1.buffer, &self.x.buffer, &self.kept.buffer);
        // Light workgroups: twice as many fit a multiprocessor, and their rows of sums are a quarter as long.
        let splits = 2 * splits(params.pixels.div_ceil(32));
        let buffers = [weights, d1, x, f, v_residual, partials];
        pass.grid(&RESIDUAL_HEAD_WEIGHTS, &buffers, bytes_of(&params), [splits, 1, 1]);
        // The two layers follow each other in the flat weights as in a row of partial sums.
        let length = (layers::FINAL.end() - layers::FUSE.offset) as u32;
        let sum = SumParams {
            splits,
            stride: length,
            rows: 1,
            length,
            target_offset: layers::FUSE.offset as u32,
            target_stride: 0,
            bias: 0,
            biases: 0,
        };
        pass.groups(&RESIDUAL_SUM, &[partials, v_weights], bytes_of(&sum), length.div_ceil(32) as usize);
        let groups = self.x.pixels().div_ceil(HEAD_PIXELS);
        pass.groups(&RESIDUAL_HEAD_BACKWARD, &[weights, v_residual, d1, f], bytes_of(&params), groups);
    }

    /// Gradient by the weights of the inputs `first..first + input.channels` of a layer, and with the first by its biases.
    fn weight_gradient(
        &self,
        pass: &mut Pass,
        (layer, first): (&Layer, usize),
        v: &Map,
        input: &Map,
        v_weights: &Buffer,
    ) {
        let Some(Training { partials, .. }) = &self.training else { return };
        let splits = splits(conv_tiles(v.size));
        let params = ConvWeightsParams {
            size: v.size,
            source: input.size,
            mode: input.mode(v.size) as u32,
            inputs: input.channels,
            outputs: v.channels,
            splits,
        };
        let buffers = [&v.buffer, &input.buffer, partials];
        pass.grid(&RESIDUAL_CONV_WEIGHTS, &buffers, bytes_of(&params), [splits, 1, 1]);
        let length = 9 * input.channels;
        let biases = if first == 0 { v.channels } else { 0 };
        let sum = SumParams {
            splits,
            stride: v.channels * (length + 1),
            rows: v.channels,
            length,
            target_offset: (layer.offset + 9 * first) as u32,
            target_stride: 9 * layer.inputs as u32,
            bias: layer.bias() as u32,
            biases,
        };
        let values = (v.channels * length + biases) as usize;
        pass.groups(&RESIDUAL_SUM, &[partials, v_weights], bytes_of(&sum), values.div_ceil(32));
    }
}
