//! From the gradient by the residual to those by the planes and by the weights.

use super::{HalfUNet, Map, Packed, groups as side_groups, padded, place};
use crate::gpu::{Buffer, Gpu, GpuError, Pass};
use crate::residual::layers::{self, HALF, INPUT, Layer, QUARTER};
use crate::residual::unet::{Mode, Store};
use bytemuck::bytes_of;
use ibgs_shaders::types::{
    HalfConvWeightsParams, HalfHeadBackwardParams, HalfHeadGradientParams, HalfResizeParams, HalfSumParams,
    HalfUnpackParams, HalfWeightsParams,
};
use ibgs_shaders::{
    HALF_CONV_WEIGHTS, HALF_HEAD_BACKWARD, HALF_HEAD_GRADIENT, HALF_POOL_BACKWARD, HALF_SUM, HALF_UNPACK,
    HALF_UPSAMPLE_BACKWARD, MatrixUnits,
};

/// Most workgroups that share the sums of one layer's weight gradient.
const MAX_SPLITS: u32 = 264;
/// Fewest tiles for a workgroup of its own.
const MIN_TILES: u32 = 4;
/// Rows of a tile of `half_conv_weights`.
const TILE_ROWS: u32 = 4;
/// Channels of the residual's gradient with padding.
const RESIDUAL_CHANNELS: usize = 3;

/// What only the backward pass needs.
#[derive(Debug)]
pub(super) struct Training {
    /// Weights for the gradients by an input: DEC1 by u1 and e1, UP1, DEC2 by u2 and e2, UP2, ENC3, ENC2, ENC1.
    turned: [Packed; 9],
    v_residual: Map,
    /// The gradient by f, then by e1.
    v_f: Map,
    v_e2: Map,
    partials: Buffer,
    /// Of the gradients while they are halves. A mean over all values makes the residual's gradients of the size of one
    /// over their number.
    scale: f32,
}

impl Packed {
    /// For the gradient by the inputs `first..first + channels` of a layer.
    fn turned(layer: &Layer, first: usize, channels: usize, groups: u32) -> Self {
        let weights = HalfWeightsParams {
            weights: (layer.offset + layer.taps * first) as u32,
            stride_out: layer.taps as u32,
            stride_in: (layer.taps * layer.inputs) as u32,
            taps: layer.taps as u32,
            turned: 1,
            channels_a: layer.outputs as u32,
            padded_a: padded(layer.outputs),
            channels_b: 0,
            padded: padded(layer.outputs),
            outputs: channels as u32,
            groups,
            into: 0,
        };
        Self { weights, bias: 0 }
    }
}

/// Groups of 3 sides of channels.
fn groups(channels: u32, units: MatrixUnits) -> u32 {
    channels.div_ceil(3 * units.side)
}

/// Tiles of a layer's size, and workgroups that share them.
fn splits(size: [u32; 2], units: MatrixUnits) -> u32 {
    let tiles = size[0].div_ceil(units.side) * size[1].div_ceil(TILE_ROWS);
    tiles.div_ceil(MIN_TILES).min(MAX_SPLITS)
}

impl Training {
    pub fn new(gpu: &Gpu, units: MatrixUnits, full: [u32; 2], at: &mut u32) -> Result<Self, GpuError> {
        let group = 3 * units.side;
        let mut turned = [
            (&layers::DEC1, 0, INPUT),
            (&layers::DEC1, INPUT, INPUT),
            (&layers::UP1, 0, HALF),
            (&layers::DEC2, 0, HALF),
            (&layers::DEC2, HALF, HALF),
            (&layers::UP2, 0, QUARTER),
            (&layers::ENC3, 0, HALF),
            (&layers::ENC2, 0, INPUT),
            (&layers::ENC1, 0, INPUT),
        ]
        .map(|(layer, first, channels)| Packed::turned(layer, first, channels, side_groups(channels, units)));
        turned.iter_mut().for_each(|packed| place(packed, units, at));
        // The padding's first channel counts as 1 in the sums.
        let blocks = groups(INPUT as u32 + 1, units) * groups(INPUT as u32, units) * 9;
        let row = 4 * u64::from(blocks * group * group);
        Ok(Self {
            turned,
            v_residual: Map::new(gpu, "residual gradients", RESIDUAL_CHANNELS, full)?,
            v_f: Map::new(gpu, "unet v_f", INPUT, full)?,
            v_e2: Map::new(gpu, "unet v_e2", HALF, full.map(|side| side / 2))?,
            partials: gpu.allocate("weight gradients", row * u64::from(splits(full, units)))?,
            // A power of two costs no digit.
            scale: 16.0 * (3 * full[0] * full[1]).next_power_of_two() as f32,
        })
    }
}

/// Through the 2 x 2 maximum and the ReLU of `activation`: completes and masks its gradient `v`.
fn pool_backward(pass: &mut Pass, activation: &Map, v_pooled: &Map, v: &Map) {
    let params = HalfResizeParams { size: v.size, source: v_pooled.size, quads: v.quads(), pad: 0 };
    let buffers = [&activation.buffer, &v_pooled.buffer, &v.buffer];
    pass.linear(&HALF_POOL_BACKWARD, &buffers, bytes_of(&params), (v.quads() * v.pixels()) as usize);
}

/// Through the enlargement: the gradient takes the place of the activation `v`.
fn upsample_backward(pass: &mut Pass, v_enlarged: &Map, v: &Map) {
    let params = HalfResizeParams { size: v_enlarged.size, source: v.size, quads: v.quads(), pad: 0 };
    let buffers = [&v_enlarged.buffer, &v.buffer];
    pass.linear(&HALF_UPSAMPLE_BACKWARD, &buffers, bytes_of(&params), (v.quads() * v.pixels()) as usize);
}

impl HalfUNet {
    /// From `v_residual`, `[height * width * 3]`, to the gradient by the input as planes, and the U-Net's part of
    /// `v_weights` (from the first weight of e1 to the end), which is assigned; the rest of `v_weights` is left alone.
    ///
    /// Consumes what the last [`HalfUNet::forward`] kept: one backward for each forward, with the same weights.
    ///
    /// # Panics
    /// When made without gradients: a bug of ours.
    pub fn backward(&self, pass: &mut Pass, weights: &Buffer, v_residual: &Buffer, v_weights: &Buffer) {
        let t = self.training.as_ref().expect("an unet made with gradients");
        let Self { x, e1, e2, b, u2, d2, u1, d1, f, .. } = self;
        t.turned.iter().for_each(|packed| self.pack(pass, weights, packed));
        let by_weights = |pass: &mut Pass, layer: &Layer, first: usize, v: &Map, input: &Map| {
            self.weight_gradient(pass, t, (layer, first), v, input, v_weights);
        };
        let by_input = |pass: &mut Pass, turned: usize, v: &Map, target: &Map, store: Store| {
            self.conv(pass, weights, &t.turned[turned], &[v], target, store);
        };
        self.head_gradient(pass, t, weights, v_residual);
        by_weights(pass, &layers::FINAL, 0, &t.v_residual, f);
        by_weights(pass, &layers::FUSE, 0, &t.v_f, d1);
        by_weights(pass, &layers::FUSE, INPUT, &t.v_f, x);
        let params = HalfHeadBackwardParams { pixels: x.pixels(), fuse: self.fuse.weights.into };
        let buffers = [&self.packed, &t.v_f.buffer, &d1.buffer, &f.buffer];
        pass.groups(&HALF_HEAD_BACKWARD, &buffers, bytes_of(&params), self.head_groups());
        // From here on d1 holds its gradient and f that of x; below u1, d2, u2 and b come to hold theirs in turn.
        let (v_e1, v_e2, v_x) = (&t.v_f, &t.v_e2, f);
        by_weights(pass, &layers::DEC1, 0, d1, u1);
        by_weights(pass, &layers::DEC1, INPUT, d1, e1);
        by_input(pass, 1, d1, v_e1, Store::Assign);
        by_input(pass, 0, d1, u1, Store::Mask);
        // d1's memory is free for gradients behind an enlargement or a maximum.
        let scratch = |channels, size| d1.reuse(channels, size);
        by_weights(pass, &layers::UP1, 0, u1, d2);
        let v_enlarged = scratch(HALF, u1.size);
        by_input(pass, 2, u1, &v_enlarged, Store::Assign);
        upsample_backward(pass, &v_enlarged, d2);
        by_weights(pass, &layers::DEC2, 0, d2, u2);
        by_weights(pass, &layers::DEC2, HALF, d2, e2);
        by_input(pass, 4, d2, v_e2, Store::Assign);
        by_input(pass, 3, d2, u2, Store::Mask);
        by_weights(pass, &layers::UP2, 0, u2, b);
        let v_enlarged = scratch(QUARTER, u2.size);
        by_input(pass, 5, u2, &v_enlarged, Store::Assign);
        upsample_backward(pass, &v_enlarged, b);
        by_weights(pass, &layers::ENC3, 0, b, e2);
        let v_pooled = scratch(HALF, b.size);
        by_input(pass, 6, b, &v_pooled, Store::Assign);
        pool_backward(pass, e2, &v_pooled, v_e2);
        by_weights(pass, &layers::ENC2, 0, v_e2, e1);
        let v_pooled = scratch(INPUT, e2.size);
        by_input(pass, 7, v_e2, &v_pooled, Store::Assign);
        pool_backward(pass, e1, &v_pooled, v_e1);
        by_weights(pass, &layers::ENC1, 0, v_e1, x);
        by_input(pass, 8, v_e1, v_x, Store::Add);
        let pixels = x.pixels();
        let params = HalfUnpackParams { pixels, channels: INPUT as u32, quads: v_x.quads(), unscale: t.scale.recip() };
        pass.linear(&HALF_UNPACK, &[&v_x.buffer, &self.v_x], bytes_of(&params), pixels as usize);
    }

    /// The residual's gradient in half precision, and that by f.
    fn head_gradient(&self, pass: &mut Pass, t: &Training, weights: &Buffer, v_residual: &Buffer) {
        let pixels = self.x.pixels();
        let params = HalfHeadGradientParams { pixels, last: layers::FINAL.offset as u32, scale: t.scale };
        let buffers = [weights, v_residual, &self.f.buffer, &t.v_residual.buffer, &t.v_f.buffer];
        pass.linear(&HALF_HEAD_GRADIENT, &buffers, bytes_of(&params), pixels as usize);
    }

    /// Gradient by the weights of the inputs `first..first + input.channels` of a layer, and with the first by its biases.
    fn weight_gradient(
        &self,
        pass: &mut Pass,
        t: &Training,
        (layer, first): (&Layer, usize),
        v: &Map,
        input: &Map,
        v_weights: &Buffer,
    ) {
        assert_eq!(v.channels, layer.outputs, "{}: gradient", layer.name);
        let (inputs, outputs, taps) = (input.channels as u32, v.channels as u32, layer.taps as u32);
        let splits = splits(v.size, self.units);
        let params = HalfConvWeightsParams {
            size: v.size,
            source: input.size,
            mode: Mode::of(input.size, v.size) as u32,
            inputs,
            quads_in: input.quads(),
            quads_out: v.quads(),
            splits,
            pad: 0,
        };
        let [groups_in, groups_out] = [inputs + 1, outputs].map(|channels| groups(channels, self.units));
        let buffers = [&v.buffer, &input.buffer, &t.partials];
        pass.grid(&HALF_CONV_WEIGHTS, &buffers, bytes_of(&params), [splits, groups_in, groups_out]);
        let sum = HalfSumParams {
            splits,
            groups_in,
            groups_out,
            taps,
            inputs,
            outputs,
            into: (layer.offset + layer.taps * first) as u32,
            stride: (layer.taps * layer.inputs) as u32,
            bias: if first == 0 { layer.bias() as u32 } else { 0 },
            unscale: t.scale.recip(),
        };
        let side = 3 * self.units.side;
        let values = (groups_in * groups_out * taps * side * side) as usize;
        pass.groups(&HALF_SUM, &[&t.partials, v_weights], bytes_of(&sum), values.div_ceil(32));
    }
}
