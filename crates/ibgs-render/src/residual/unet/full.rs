//! The U-Net's layers in float32, on any adapter. Activations are planes, `[channel][row][column]`, or for frames words with the
//! halves of two channels, `[channel / 2][row][column]`.

use super::Arithmetic;
use super::backend::{Backend, BackwardBuffers, conv_input, splits};
use super::memory::{Activations, Map};
use crate::gpu::{Buffer, Gpu, Pass, RawBuffer};
use crate::raster::Keep;
use crate::residual::layers::{FINAL, FUSE, INPUT, Layer, Part};
use ibgs_shaders::bindings::{
    ResidualConvBindings, ResidualConvPackedBindings, ResidualConvWeightsBindings, ResidualHeadBackwardBindings,
    ResidualHeadBindings, ResidualHeadPackedBindings, ResidualHeadWeightsBindings, ResidualPoolBackwardBindings,
    ResidualSumBindings, ResidualUpsampleBackwardBindings,
};
use ibgs_shaders::layers::{CONV_OUTPUTS, CONV_TILE};
use ibgs_shaders::types::{ConvParams, ConvWeightsParams, HeadParams, PoolParams, SumParams, UpsampleParams};
use ibgs_shaders::{Bindings, Store};

/// Pixels of a workgroup of the head.
const HEAD_PIXELS: u32 = 512;
/// Fewest tiles for a workgroup of its own.
const MIN_TILES: u32 = 8;
/// The same on processors, which write and add rows of partial sums slowly.
const MIN_TILES_NARROW: u32 = 20;
/// Most workgroups that share the sums of one layer's weight gradient: two for each of a large GPU's 132
/// multiprocessors.
const MAX_SPLITS: u32 = 264;
/// Values of the longest row of partial sums: 38 x 38 x 9 weights and 38 biases.
const LONGEST_ROW: usize = 9 * INPUT * INPUT + INPUT;

/// Float32.
#[derive(Debug)]
pub(super) struct Full {
    /// Fewest tiles for a workgroup of its own.
    fewest: u32,
}

impl Full {
    pub(super) fn new(gpu: &Gpu) -> Self {
        let is_narrow = gpu.subgroup_lanes == Some(8);
        Self { fewest: if is_narrow { MIN_TILES_NARROW } else { MIN_TILES } }
    }

    /// Workgroups that share the sums of a weight gradient.
    fn splits(&self, tiles: u32) -> u32 {
        splits(tiles, self.fewest, MAX_SPLITS)
    }
}

/// Tiles of 16 x 2 pixels, those of `residual_conv_weights`.
fn conv_tiles(size: [u32; 2]) -> u32 {
    size[0].div_ceil(16) * size[1].div_ceil(2)
}

/// A convolution; `params` say which weights and biases.
fn conv(pass: &mut Pass, weights: &Buffer<f32>, inputs: &[&Map], output: &Map, store: Store, params: ConvParams) {
    let (a, b) = (inputs[0], inputs.get(1).copied());
    let outputs = output.channels as u32;
    let groups = outputs.div_ceil(CONV_OUTPUTS);
    assert!((1..=2).contains(&groups), "one launch has at most 40 outputs");
    let params = ConvParams {
        size: output.size,
        source: a.size,
        mode: conv_input(a.size, output.size) as u32,
        channels_a: a.channels as u32,
        channels_b: b.map_or(0, |m| m.channels as u32),
        outputs,
        store: store as u32,
        groups,
        ..params
    };
    let b = b.unwrap_or(a);
    match output.arithmetic() {
        Arithmetic::Packed => {
            let (input_a, input_b, output) = (a.words(), b.words(), output.words());
            launch(pass, &ResidualConvPackedBindings { weights, input_a, input_b, output }, &params);
        }
        _ => {
            let (input_a, input_b, output) = (a.planes(), b.planes(), output.planes());
            launch(pass, &ResidualConvBindings { weights, input_a, input_b, output }, &params);
        }
    }
}

/// The workgroups of a convolution.
fn launch<'b, T>(pass: &mut Pass, bindings: &T, params: &ConvParams)
where
    T: Bindings<'b, RawBuffer, Params = ConvParams>,
{
    let ([width, height], groups) = (params.size, params.groups);
    if pass.gpu().subgroup_lanes == Some(8) {
        // Blocks of 8 x 4 pixels, 16 to a workgroup.
        let blocks = width.div_ceil(8) * height.div_ceil(4) * groups;
        pass.groups(bindings, params, blocks.div_ceil(16) as usize);
    } else {
        pass.grid(bindings, params, [width.div_ceil(CONV_TILE[0]), height.div_ceil(CONV_TILE[1] * 4 / groups), 1]);
    }
}

fn head_params(maps: &Activations) -> HeadParams {
    HeadParams {
        pixels: maps.x.pixels(),
        fuse: FUSE.offset as u32,
        fuse_bias: FUSE.bias() as u32,
        last: FINAL.offset as u32,
        last_bias: FINAL.bias() as u32,
        keep: u32::from(maps.keep == Keep::Gradients),
    }
}

/// Adds the rows of partial sums, `values` in all that are wanted.
fn sum(pass: &mut Pass, buffers: &BackwardBuffers, params: SumParams, values: u32) {
    let bindings = ResidualSumBindings { partials: &buffers.gradients.partials, sums: buffers.v_weights };
    pass.groups(&bindings, &params, values.div_ceil(32) as usize);
}

impl Backend for Full {
    fn conv(&self, pass: &mut Pass, weights: &Buffer<f32>, layer: &Layer, inputs: &[&Map], output: &Map) {
        let params = ConvParams {
            weights: layer.offset as u32,
            stride_out: layer.row() as u32,
            stride_in: 9,
            bias: layer.bias() as u32,
            ..Default::default()
        };
        conv(pass, weights, inputs, output, Store::Relu, params);
    }

    fn head(&self, pass: &mut Pass, weights: &Buffer<f32>, maps: &Activations) {
        let params = head_params(maps);
        let groups = params.pixels.div_ceil(HEAD_PIXELS) as usize;
        let Activations { x, d1, f, residual, .. } = maps;
        match x.arithmetic() {
            Arithmetic::Packed => {
                let (d1, x) = (d1.words(), x.words());
                pass.groups(&ResidualHeadPackedBindings { weights, residual, d1, x }, &params, groups);
            }
            _ => {
                let (d1, x, f) = (d1.planes(), x.planes(), f.planes());
                pass.groups(&ResidualHeadBindings { weights, residual, d1, x, f }, &params, groups);
            }
        }
    }

    fn head_backward(&self, pass: &mut Pass, buffers: &BackwardBuffers) {
        let BackwardBuffers { maps, gradients, weights, v_residual, .. } = *buffers;
        let params = head_params(maps);
        let (d1, x, f) = (maps.d1.planes(), maps.x.planes(), maps.f.planes());
        // Light workgroups: twice as many fit a multiprocessor, and their rows of sums are a quarter as long.
        let splits = 2 * self.splits(params.pixels.div_ceil(32));
        let partials = &gradients.partials;
        let bindings = ResidualHeadWeightsBindings { weights, d1, x, f, v_residual, partials };
        pass.grid(&bindings, &params, [splits, 1, 1]);
        // The two layers follow each other in the flat weights as in a row of partial sums.
        let length = (FINAL.end() - FUSE.offset) as u32;
        let target_offset = FUSE.offset as u32;
        let row = SumParams { splits, stride: length, rows: 1, length, target_offset, ..Default::default() };
        sum(pass, buffers, row, length);
        let groups = params.pixels.div_ceil(HEAD_PIXELS) as usize;
        pass.groups(&ResidualHeadBackwardBindings { weights, v_residual, d1, f }, &params, groups);
    }

    fn weight_gradient(&self, pass: &mut Pass, buffers: &BackwardBuffers, part: Part, v: &Map, input: &Map) {
        let (inputs, outputs) = (input.channels as u32, v.channels as u32);
        let splits = self.splits(conv_tiles(v.size));
        let mode = conv_input(input.size, v.size) as u32;
        let params = ConvWeightsParams { size: v.size, source: input.size, mode, inputs, outputs, splits };
        let partials = &buffers.gradients.partials;
        let bindings = ResidualConvWeightsBindings { v: v.planes(), input: input.planes(), partials };
        pass.grid(&bindings, &params, [splits, 1, 1]);
        let length = 9 * inputs;
        let biases = if part.first == 0 { outputs } else { 0 };
        let rows = SumParams {
            splits,
            stride: outputs * (length + 1),
            rows: outputs,
            length,
            target_offset: part.offset() as u32,
            target_stride: part.layer.row() as u32,
            bias: part.layer.bias() as u32,
            biases,
        };
        sum(pass, buffers, rows, outputs * length + biases);
    }

    /// The same convolution with strides exchanged and taps turned.
    fn input_gradient(&self, pass: &mut Pass, weights: &Buffer<f32>, part: Part, v: &Map, v_input: &Map, store: Store) {
        let params = ConvParams {
            weights: part.offset() as u32,
            stride_out: 9,
            stride_in: part.layer.row() as u32,
            turned: 1,
            ..Default::default()
        };
        conv(pass, weights, &[v], v_input, store, params);
    }

    fn pool_backward(&self, pass: &mut Pass, activation: &Map, v_pooled: &Map, v: &Map) {
        let params = PoolParams { size: v.size, channels: v.channels as u32, pad: 0 };
        let bindings = ResidualPoolBackwardBindings {
            activation: activation.planes(),
            v_pooled: v_pooled.planes(),
            v: v.planes(),
        };
        pass.linear(&bindings, &params, v.channels * v.pixels() as usize);
    }

    fn upsample_backward(&self, pass: &mut Pass, v_enlarged: &Map, v: &Map) {
        let params = UpsampleParams { size: v_enlarged.size, source: v.size, channels: v.channels as u32, pad: 0 };
        let bindings = ResidualUpsampleBackwardBindings { v_enlarged: v_enlarged.planes(), v: v.planes() };
        pass.linear(&bindings, &params, v.channels * v.pixels() as usize);
    }

    fn partials(&self, size: [u32; 2]) -> usize {
        // The head has twice as many rows a quarter as long, and its blocks of 32 pixels are no more than the tiles.
        LONGEST_ROW * self.splits(conv_tiles(size)) as usize
    }
}
