//! The U-Net's layers in half precision on the adapter's matrix units.
//!
//! Activations are channels last, `[pixel][channel]`, padded to a multiple of 16 channels; products of halves are summed
//! in float32. Gradients are multiplied by a scale while they are halves, so that the smallest ones that matter have all
//! their digits.

use super::Arithmetic;
use super::backend::{Backend, BackwardBuffers, conv_input, splits};
use super::memory::{Activations, Map, padded};
use crate::gpu::{Buffer, Gpu, GpuError, Pass, RawBuffer};
use crate::raster::Keep;
use crate::residual::layers::{FINAL, FUSE, INPUT, Layer, Part, UNET};
use ibgs_shaders::bindings::{
    HalfConvBindings, HalfConvWeightsBindings, HalfHeadBackwardBindings, HalfHeadBindings, HalfHeadGradientBindings,
    HalfLinearWeightsBindings, HalfPoolBackwardBindings, HalfSumBindings, HalfUnpackBindings,
    HalfUpsampleBackwardBindings, HalfWeightsBindings,
};
use ibgs_shaders::layers::{HALF_CONV_ROWS, HALF_SUBGROUPS};
use ibgs_shaders::types::{
    F16, HalfConvParams, HalfConvWeightsParams, HalfHeadBackwardParams, HalfHeadGradientParams, HalfHeadParams,
    HalfLinearWeightsParams, HalfResizeParams, HalfSumParams, HalfUnpackParams, HalfWeights, HalfWeightsParams,
};
use ibgs_shaders::{Bindings, MatrixUnits, Store};
use std::ops::Range;

/// Fewest tiles for a workgroup of its own.
const MIN_TILES: u32 = 2;
/// Most workgroups that share the sums of one layer's weight gradient: one for each of a large GPU's 132
/// multiprocessors, which have registers for no more.
const MAX_SPLITS: u32 = 132;

/// A layer's weights as a convolution on the matrix units reads them: forward, or for the gradient by an input.
#[derive(Clone, Copy, Debug)]
struct Packed {
    weights: HalfWeights,
    bias: u32,
}

impl Packed {
    /// Forward.
    fn forward(layer: &Layer, units: MatrixUnits) -> Self {
        let [first, second] = layer.read;
        let weights = HalfWeights {
            weights: layer.offset as u32,
            stride_out: layer.row() as u32,
            stride_in: layer.taps as u32,
            taps: layer.taps as u32,
            turned: 0,
            channels_a: first as u32,
            padded_a: padded(first),
            channels_b: second as u32,
            padded: padded(first) + padded(second),
            outputs: layer.outputs as u32,
            groups: if *layer == FINAL { 1 } else { 3 * triples(layer.outputs, units) },
            into: 0,
        };
        Self { weights, bias: layer.bias() as u32 }
    }

    /// For the gradient by a part of the inputs: strides exchanged and taps turned.
    fn turned(part: Part, units: MatrixUnits) -> Self {
        let layer = part.layer;
        let weights = HalfWeights {
            weights: part.offset() as u32,
            stride_out: layer.taps as u32,
            stride_in: layer.row() as u32,
            taps: layer.taps as u32,
            turned: 1,
            channels_a: layer.outputs as u32,
            padded_a: padded(layer.outputs),
            channels_b: 0,
            padded: padded(layer.outputs),
            outputs: part.channels as u32,
            groups: 3 * triples(part.channels, units),
            into: 0,
        };
        Self { weights, bias: 0 }
    }

    /// Groups of 4 that the packed weights take.
    fn quads(&self, units: MatrixUnits) -> u32 {
        self.weights.taps * self.weights.padded * self.weights.groups * units.side / 4
    }
}

/// Those that begin with this weight of the flat ones.
fn find(packed: &[Packed], first: usize) -> &Packed {
    packed.iter().find(|packed| packed.weights.weights == first as u32).expect("every layer's weights are packed")
}

/// Groups of three matrices' sides of channels: what a workgroup makes.
fn triples(channels: usize, units: MatrixUnits) -> u32 {
    (channels as u32).div_ceil(3 * units.side)
}

/// Values a pixel with padding, divided by 4.
fn quads(map: &Map) -> u32 {
    padded(map.channels) / 4
}

/// Half precision on matrix units.
#[derive(Debug)]
pub(super) struct Half {
    units: MatrixUnits,
    /// All packed weights, one behind the other.
    packed: Buffer<[F16; 4]>,
    /// Where each layer's lie: those of `forward` and then those of `turned`.
    layers: Buffer<HalfWeights>,
    sizes: HalfWeightsParams,
    forward: Vec<Packed>,
    /// For the gradients by the inputs of the 3 x 3 layers, last layer first; empty without gradients.
    turned: Vec<Packed>,
    /// The gradient by the output; none without gradients.
    v_residual: Option<Map>,
    /// Of the gradients while they are halves. A mean over all values makes the residual's gradients of the size of one
    /// over their number.
    scale: f32,
}

impl Half {
    /// # Errors
    /// Not enough memory, or more than the device binds at once.
    pub fn new(gpu: &Gpu, units: MatrixUnits, size: [u32; 2], keep: Keep) -> Result<Self, GpuError> {
        let mut forward: Vec<_> = UNET.iter().map(|layer| Packed::forward(layer, units)).collect();
        let (mut turned, mut v_residual) = (Vec::new(), None);
        if keep == Keep::Gradients {
            let parts = UNET.iter().rev().filter(|layer| layer.taps == 9).flat_map(Layer::parts);
            turned.extend(parts.filter(|part| part.channels > 0).map(|part| Packed::turned(part, units)));
            v_residual = Some(Map::new(gpu, "residual gradients", Arithmetic::Half, FINAL.outputs, size)?);
        }
        let mut length = 0;
        for packed in forward.iter_mut().chain(&mut turned) {
            packed.weights.into = length;
            length += packed.quads(units);
        }
        let layers: Vec<_> = forward.iter().chain(&turned).map(|packed| packed.weights).collect();
        let sizes = HalfWeightsParams { layers: layers.len() as u32, quads: length };
        let layers = gpu.upload("layers of the network", &layers)?;
        let packed = gpu.allocate("packed weights", length as usize)?;
        // A power of two costs no digit.
        let scale = 16.0 * (3 * size[0] * size[1]).next_power_of_two() as f32;
        Ok(Self { units, packed, layers, sizes, forward, turned, v_residual, scale })
    }

    fn conv3x3(
        &self,
        pass: &mut Pass,
        weights: &Buffer<f32>,
        packed: &Packed,
        inputs: &[&Map],
        output: &Map,
        store: Store,
    ) {
        let (a, b) = (inputs[0], inputs.get(1).copied());
        assert_eq!(a.channels as u32, packed.weights.channels_a, "inputs of a convolution");
        assert_eq!(output.channels as u32, packed.weights.outputs, "outputs of a convolution");
        let params = HalfConvParams {
            size: output.size,
            source: a.size,
            mode: conv_input(a.size, output.size) as u32,
            pairs_a: quads(a) / 2,
            pairs_b: b.map_or(0, quads) / 2,
            quads_out: quads(output),
            outputs: output.channels as u32,
            bias: packed.bias,
            packed: packed.weights.into,
            packed_groups: packed.weights.groups,
            store: store as u32,
            pad: 0,
        };
        let side = self.units.side;
        let grid = [output.size[0].div_ceil(side), output.size[1].div_ceil(HALF_CONV_ROWS), packed.weights.groups / 3];
        let (input_a, input_b) = (&a.pairs(), &b.unwrap_or(a).pairs());
        let bindings = HalfConvBindings { weights, packed: &self.packed, input_a, input_b, output: output.halves() };
        pass.grid(&bindings, &params, grid);
    }

    /// Workgroups of the head's kernels, of which a subgroup takes so many matrices of pixels.
    fn head_groups(&self, x: &Map, matrices: u32) -> usize {
        x.pixels().div_ceil(HALF_SUBGROUPS * matrices * self.units.side) as usize
    }

    /// Workgroups that share the tiles of a 3 x 3 layer's size.
    fn conv_splits(&self, size: [u32; 2]) -> u32 {
        let side = self.units.side;
        splits(size[0].div_ceil(side) * size[1].div_ceil(side / 2), MIN_TILES, MAX_SPLITS)
    }

    /// Workgroups that share the pixels of a 1 x 1 layer. Their sums need less room than those of nine taps.
    fn linear_splits(&self, pixels: u32) -> u32 {
        splits(pixels.div_ceil(3 * self.units.side), MIN_TILES, 4 * MAX_SPLITS)
    }
}

/// Back through a change of size, to the gradient `v`.
fn resize<'b, T>(pass: &mut Pass, bindings: &T, [size, source]: [[u32; 2]; 2], v: &Map)
where
    T: Bindings<'b, RawBuffer, Params = HalfResizeParams>,
{
    let params = HalfResizeParams { size, source, quads: quads(v), pad: 0 };
    pass.linear(bindings, &params, (params.quads * v.pixels()) as usize);
}

impl Backend for Half {
    fn prepare(&self, pass: &mut Pass, weights: &Buffer<f32>) {
        let bindings = HalfWeightsBindings { weights, layers: &self.layers, packed: &self.packed };
        pass.linear(&bindings, &self.sizes, self.sizes.quads as usize);
    }

    fn conv(&self, pass: &mut Pass, weights: &Buffer<f32>, layer: &Layer, inputs: &[&Map], output: &Map) {
        self.conv3x3(pass, weights, find(&self.forward, layer.offset), inputs, output, Store::Relu);
    }

    fn head(&self, pass: &mut Pass, weights: &Buffer<f32>, maps: &Activations) {
        let [fuse, last] = [FUSE, FINAL].map(|layer| find(&self.forward, layer.offset));
        let params = HalfHeadParams {
            pixels: maps.x.pixels(),
            fuse_bias: fuse.bias,
            fuse: fuse.weights.into,
            last_bias: last.bias,
            last: last.weights.into,
            keep: u32::from(maps.keep == Keep::Gradients),
        };
        let Activations { x, d1, f, residual, .. } = maps;
        let bindings = HalfHeadBindings {
            weights,
            packed: &self.packed,
            d1: d1.halves(),
            x: x.halves(),
            residual,
            kept: f.halves(),
        };
        pass.groups(&bindings, &params, self.head_groups(x, 2));
    }

    fn head_backward(&self, pass: &mut Pass, buffers: &BackwardBuffers) {
        let Activations { x, d1, f, .. } = buffers.maps;
        let v_residual = self.v_residual.as_ref().expect("an unet made with gradients");
        let v_f = &buffers.gradients.v_e1;
        let (pixels, groups) = (x.pixels(), self.head_groups(x, 1));
        let params = HalfHeadGradientParams { pixels, last: FINAL.offset as u32, scale: self.scale };
        let bindings = HalfHeadGradientBindings {
            weights: buffers.weights,
            v_residual: buffers.v_residual,
            f: f.halves(),
            v_out: v_residual.halves(),
            v_f: v_f.halves(),
        };
        pass.linear(&bindings, &params, (pixels * quads(v_f)) as usize);
        let ([by_f, _], [by_d1, by_x]) = (FINAL.parts(), FUSE.parts());
        self.weight_gradient(pass, buffers, by_f, v_residual, f);
        self.weight_gradient(pass, buffers, by_d1, v_f, d1);
        self.weight_gradient(pass, buffers, by_x, v_f, x);
        let params = HalfHeadBackwardParams { pixels, fuse: find(&self.forward, FUSE.offset).weights.into };
        let (v_f, d1, f) = (v_f.halves(), d1.halves(), f.halves());
        pass.groups(&HalfHeadBackwardBindings { packed: &self.packed, v_f, d1, f }, &params, groups);
    }

    fn weight_gradient(&self, pass: &mut Pass, buffers: &BackwardBuffers, part: Part, v: &Map, input: &Map) {
        let (layer, partials) = (part.layer, &buffers.gradients.partials);
        let (inputs, outputs, taps) = (input.channels as u32, v.channels as u32, layer.taps as u32);
        let (pairs_in, pairs_out) = (quads(input) / 2, quads(v) / 2);
        // The padding's first channel counts as 1 in the sums.
        let [groups_in, groups_out] = [input.channels + 1, v.channels].map(|channels| triples(channels, self.units));
        let splits = if taps == 1 {
            let splits = self.linear_splits(v.pixels());
            let params = HalfLinearWeightsParams { pixels: v.pixels(), inputs, pairs_in, pairs_out, splits };
            let bindings = HalfLinearWeightsBindings { v: &v.pairs(), input: &input.pairs(), partials };
            pass.grid(&bindings, &params, [splits, groups_in, groups_out]);
            splits
        } else {
            let splits = self.conv_splits(v.size);
            let (size, source, mode) = (v.size, input.size, conv_input(input.size, v.size) as u32);
            let params = HalfConvWeightsParams { size, source, mode, inputs, pairs_in, pairs_out, splits, pad: 0 };
            let bindings = HalfConvWeightsBindings { v: &v.pairs(), input: &input.pairs(), partials };
            pass.grid(&bindings, &params, [splits, groups_in, groups_out]);
            splits
        };
        let sum = HalfSumParams {
            splits,
            groups_in,
            groups_out,
            taps,
            inputs,
            outputs,
            into: part.offset() as u32,
            stride: layer.row() as u32,
            bias: if part.first == 0 { layer.bias() as u32 } else { 0 },
            unscale: self.scale.recip(),
        };
        let group = 3 * self.units.side;
        let values = groups_in * groups_out * taps * group * group;
        pass.groups(&HalfSumBindings { partials, sums: buffers.v_weights }, &sum, values.div_ceil(32) as usize);
    }

    fn input_gradient(&self, pass: &mut Pass, weights: &Buffer<f32>, part: Part, v: &Map, v_input: &Map, store: Store) {
        self.conv3x3(pass, weights, find(&self.turned, part.offset()), &[v], v_input, store);
    }

    fn pool_backward(&self, pass: &mut Pass, activation: &Map, v_pooled: &Map, v: &Map) {
        let bindings =
            HalfPoolBackwardBindings { activation: activation.halves(), v_pooled: v_pooled.halves(), v: v.halves() };
        resize(pass, &bindings, [v.size, v_pooled.size], v);
    }

    fn upsample_backward(&self, pass: &mut Pass, v_enlarged: &Map, v: &Map) {
        let bindings = HalfUpsampleBackwardBindings { v_enlarged: v_enlarged.halves(), v: v.halves() };
        resize(pass, &bindings, [v_enlarged.size, v.size], v);
    }

    fn finish(&self, pass: &mut Pass, f: &Map, channels: Range<usize>, planes: &Buffer<f32>) {
        let pixels = f.pixels();
        let params = HalfUnpackParams {
            pixels,
            first: channels.start as u32,
            channels: channels.len() as u32,
            quads: quads(f),
            unscale: self.scale.recip(),
            pad: 0,
            pads: [0; 2],
        };
        pass.linear(&HalfUnpackBindings { packed: f.halves(), planes }, &params, pixels as usize);
    }

    fn multiplies_features(&self) -> bool {
        // With more lanes the kernels would need more workgroup memory than the units are asked for.
        self.units == MatrixUnits { side: 16, lanes: 32 }
    }

    fn unscale(&self) -> Option<f32> {
        self.multiplies_features().then(|| self.scale.recip())
    }

    fn partials(&self, size: [u32; 2]) -> usize {
        let group = 3 * self.units.side;
        let blocks = triples(INPUT + 1, self.units) * triples(INPUT, self.units) * 9;
        (blocks * group * group) as usize * self.conv_splits(size) as usize
    }
}
