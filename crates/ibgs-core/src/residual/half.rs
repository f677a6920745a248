//! The U-Net in half precision on the adapter's matrix units, forward and backward (method.md section 6).
//!
//! Activations are channels last, `[pixel][channel]`, padded to a multiple of 16 channels; products of halves are summed in
//! float32. As in [`UNet`](super::unet::U-Net) concatenations, maxima and enlargements are never stored.
//! Gradients are multiplied by a scale while they are halves, so that the smallest ones that matter have all their digits.

mod backward;
pub mod choice;

use super::layers::{self, HALF, INPUT, Layer, QUARTER};
use super::unet::{Mode, Store};
use crate::gpu::{Buffer, Gpu, GpuError, Pass};
use crate::raster::Keep;
use backward::Training;
use bytemuck::bytes_of;
use half::f16;
use half::slice::HalfFloatSliceExt;
use ibgs_shaders::types::{HalfConvParams, HalfHeadParams, HalfWeightsParams};
use ibgs_shaders::{HALF_CONV, HALF_HEAD, HALF_WEIGHTS, MatrixUnits};

/// Rows of a convolution's workgroup.
const ROWS: u32 = 16;
/// Subgroups of a workgroup.
const SUBGROUPS: u32 = 4;

/// Channels with padding.
fn padded(channels: usize) -> u32 {
    (channels as u32).next_multiple_of(16)
}

/// Activations of one size, channels last.
#[derive(Clone, Debug)]
struct Map {
    buffer: Buffer,
    channels: usize,
    size: [u32; 2],
}

impl Map {
    /// Room for whole matrices behind the last pixel.
    fn bytes(channels: usize, size: [u32; 2]) -> u64 {
        2 * u64::from(padded(channels)) * (u64::from(size[0]) * u64::from(size[1])).next_multiple_of(16)
    }

    fn new(gpu: &Gpu, what: &'static str, channels: usize, size: [u32; 2]) -> Result<Self, GpuError> {
        Ok(Self { buffer: gpu.allocate(what, Self::bytes(channels, size))?, channels, size })
    }

    /// Another map in the same memory.
    fn reuse(&self, channels: usize, size: [u32; 2]) -> Self {
        let bytes = Self::bytes(channels, size);
        assert!(bytes <= self.buffer.size, "a map does not fit its memory");
        Self { buffer: self.buffer.part(0, bytes), channels, size }
    }

    fn pixels(&self) -> u32 {
        self.size[0] * self.size[1]
    }

    fn quads(&self) -> u32 {
        padded(self.channels) / 4
    }
}

/// A layer's weights as a convolution on the matrix units reads them: forward, or for the gradient by an input.
#[derive(Clone, Copy, Debug)]
struct Packed {
    weights: HalfWeightsParams,
    bias: u32,
}

impl Packed {
    /// Forward, with `first` channels in the first input and `groups` groups of a matrix' side of outputs.
    fn forward(layer: &Layer, first: usize, groups: u32) -> Self {
        let second = layer.inputs - first;
        let weights = HalfWeightsParams {
            weights: layer.offset as u32,
            stride_out: (layer.taps * layer.inputs) as u32,
            stride_in: layer.taps as u32,
            taps: layer.taps as u32,
            turned: 0,
            channels_a: first as u32,
            padded_a: padded(first),
            channels_b: second as u32,
            padded: padded(first) + if second == 0 { 0 } else { padded(second) },
            outputs: layer.outputs as u32,
            groups,
            into: 0,
        };
        Self { weights, bias: layer.bias() as u32 }
    }

    /// Groups of 4 that the packed weights take.
    fn quads(&self, units: MatrixUnits) -> u32 {
        self.weights.taps * self.weights.padded * self.weights.groups * units.side / 4
    }
}

/// The convolutions with the channels of their first input.
const CONVOLUTIONS: [(&Layer, usize); 7] = [
    (&layers::ENC1, INPUT),
    (&layers::ENC2, INPUT),
    (&layers::ENC3, HALF),
    (&layers::UP2, QUARTER),
    (&layers::DEC2, HALF),
    (&layers::UP1, HALF),
    (&layers::DEC1, INPUT),
];

/// Memory for images of one size.
#[derive(Debug)]
pub struct HalfUNet {
    units: MatrixUnits,
    packed: Buffer,
    convolutions: [Packed; 7],
    fuse: Packed,
    last: Packed,
    /// The gradient by the input as planes in float32; a stub without gradients.
    v_x: Buffer,
    residual: Buffer,
    x: Map,
    e1: Map,
    e2: Map,
    b: Map,
    u2: Map,
    d2: Map,
    u1: Map,
    d1: Map,
    /// The last layer's input; a stub without gradients.
    f: Map,
    training: Option<Training>,
}

/// Gives each its place in the packed weights, one behind the other from `at` on.
fn place(packed: &mut Packed, units: MatrixUnits, at: &mut u32) {
    packed.weights.into = *at;
    *at += packed.quads(units);
}

/// Groups of a matrix' side of a convolution's outputs; a workgroup makes three.
fn groups(outputs: usize, units: MatrixUnits) -> u32 {
    (outputs as u32).next_multiple_of(3 * units.side) / units.side
}

impl HalfUNet {
    /// Memory for images of `width` x `height` pixels: 446 bytes a pixel, with `gradients` 868; none where the adapter has no
    /// matrix units.
    ///
    /// # Errors
    /// Not enough memory, or more than the device binds at once.
    pub fn new(gpu: &Gpu, width: u32, height: u32, keep: Keep) -> Result<Option<Self>, GpuError> {
        let gradients = keep == Keep::Gradients;
        let Some(units) = gpu.matrix_units else { return Ok(None) };
        let mut at = 0;
        let mut convolutions =
            CONVOLUTIONS.map(|(layer, first)| Packed::forward(layer, first, groups(layer.outputs, units)));
        convolutions.iter_mut().for_each(|packed| place(packed, units, &mut at));
        let mut fuse = Packed::forward(&layers::FUSE, INPUT, padded(INPUT) / units.side);
        place(&mut fuse, units, &mut at);
        let mut last = Packed::forward(&layers::FINAL, INPUT, 1);
        place(&mut last, units, &mut at);
        let [full, half, quarter] = [1, 2, 4].map(|s| [width / s, height / s]);
        let map = |what, channels, size| Map::new(gpu, what, channels, size);
        let training = gradients.then(|| Training::new(gpu, units, full, &mut at)).transpose()?;
        let pixels = u64::from(width) * u64::from(height);
        Ok(Some(Self {
            units,
            packed: gpu.allocate("packed weights", 8 * u64::from(at))?,
            convolutions,
            fuse,
            last,
            v_x: gpu.allocate("unet v_x", 4 * INPUT as u64 * if gradients { pixels } else { 1 })?,
            residual: gpu.allocate("residual", 12 * pixels)?,
            x: map("unet x", INPUT, full)?,
            e1: map("unet e1", INPUT, full)?,
            e2: map("unet e2", HALF, half)?,
            b: map("unet b", QUARTER, quarter)?,
            u2: map("unet u2", HALF, half)?,
            d2: map("unet d2", HALF, half)?,
            u1: map("unet u1", INPUT, full)?,
            d1: map("unet d1", INPUT, full)?,
            f: map("unet f", INPUT, if gradients { full } else { [1, 1] })?,
            training,
        }))
    }

    /// The input in half precision, `[height * width][48]`, for the caller to write before every pass.
    pub fn x(&self) -> &Buffer {
        &self.x.buffer
    }

    /// Writes the input from planes, `[38][height * width]`.
    pub fn write_input(&self, gpu: &Gpu, planes: &[f32]) {
        let (pixels, channels) = (self.x.pixels() as usize, padded(INPUT) as usize);
        let mut packed = vec![f16::ZERO; pixels * channels];
        for (channel, plane) in planes.chunks_exact(pixels).enumerate() {
            plane.iter().enumerate().for_each(|(p, v)| packed[p * channels + channel] = f16::from_f32(*v));
        }
        gpu.queue.write_buffer(
            &self.x.buffer.buffer,
            self.x.buffer.offset,
            bytemuck::cast_slice(packed.reinterpret_cast()),
        );
    }

    /// The gradient by the input after [`HalfUNet::backward`], `[38][height * width]`.
    pub fn v_x(&self) -> &Buffer {
        &self.v_x
    }

    /// The output of [`HalfUNet::forward`], `[height * width * 3]`.
    pub fn residual(&self) -> &Buffer {
        &self.residual
    }

    /// Whether [`HalfUNet::backward`] can run.
    pub fn has_gradients(&self) -> bool {
        self.training.is_some()
    }

    /// From the input to the residual. `weights`: the network's flat weights ([`layers`]).
    pub fn forward(&self, pass: &mut Pass, weights: &Buffer) {
        let Self { x, e1, e2, b, u2, d2, u1, d1, .. } = self;
        let pixels = x.pixels();
        for packed in self.convolutions.iter().chain([&self.fuse, &self.last]) {
            self.pack(pass, weights, packed);
        }
        let steps: [(&[&Map], &Map); 7] =
            [(&[x], e1), (&[e1], e2), (&[e2], b), (&[b], u2), (&[u2, e2], d2), (&[d2], u1), (&[u1, e1], d1)];
        for (packed, (inputs, output)) in self.convolutions.iter().zip(steps) {
            self.conv(pass, weights, packed, inputs, output, Store::Relu);
        }
        let params = HalfHeadParams {
            pixels,
            fuse_bias: self.fuse.bias,
            fuse: self.fuse.weights.into,
            last_bias: self.last.bias,
            last: self.last.weights.into,
            keep: u32::from(self.has_gradients()),
        };
        let buffers = [weights, &self.packed, &d1.buffer, &x.buffer, &self.residual, &self.f.buffer];
        pass.groups(&HALF_HEAD, &buffers, bytes_of(&params), self.head_groups());
    }

    /// Workgroups of the head's kernels.
    fn head_groups(&self) -> usize {
        self.x.pixels().div_ceil(SUBGROUPS * self.units.side) as usize
    }

    fn pack(&self, pass: &mut Pass, weights: &Buffer, packed: &Packed) {
        pass.linear(
            &HALF_WEIGHTS,
            &[weights, &self.packed],
            bytes_of(&packed.weights),
            packed.quads(self.units) as usize,
        );
    }

    fn conv(&self, pass: &mut Pass, weights: &Buffer, packed: &Packed, inputs: &[&Map], output: &Map, store: Store) {
        let (a, b) = (inputs[0], inputs.get(1).copied());
        assert_eq!(a.channels as u32, packed.weights.channels_a, "inputs of a convolution");
        assert_eq!(output.channels as u32, packed.weights.outputs, "outputs of a convolution");
        let side = self.units.side;
        let params = HalfConvParams {
            size: output.size,
            source: a.size,
            mode: Mode::of(a.size, output.size) as u32,
            quads_a: a.quads(),
            quads_b: b.map_or(0, Map::quads),
            quads_out: output.quads(),
            outputs: output.channels as u32,
            bias: packed.bias,
            packed: packed.weights.into,
            packed_groups: packed.weights.groups,
            store: store as u32,
            pad: 0,
        };
        let grid = [output.size[0].div_ceil(side), output.size[1].div_ceil(ROWS), packed.weights.groups / 3];
        let buffers = [weights, &self.packed, &a.buffer, &b.unwrap_or(a).buffer, &output.buffer];
        pass.grid(&HALF_CONV, &buffers, bytes_of(&params), grid);
    }
}
