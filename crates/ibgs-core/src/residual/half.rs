//! The hourglass in half precision on the adapter's matrix units: rendering alone (method.md section 6).
//!
//! Activations are channels last, `[pixel][channel]`, padded to a multiple of 16 channels; products of halves are summed in
//! float32. As in [`Hourglass`](super::hourglass::Hourglass) concatenations, maxima and enlargements are never stored.

use super::layers::{self, HALF, INPUT, Layer, QUARTER};
use crate::gpu::{Buffer, Gpu, GpuError, Pass};
use bytemuck::bytes_of;
use ibgs_shaders::types::{HalfConvParams, HalfHeadParams, HalfPackParams, HalfWeightsParams};
use ibgs_shaders::{HALF_CONV, HALF_HEAD, HALF_PACK, HALF_WEIGHTS, MatrixUnits};

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

    fn quads(&self) -> u32 {
        padded(self.channels) / 4
    }

    /// How a convolution of size `size` reads it; as in `shared/residual_source.wgsl`.
    fn mode(&self, size: [u32; 2]) -> u32 {
        match self.size[0].cmp(&size[0]) {
            std::cmp::Ordering::Equal => 0,
            std::cmp::Ordering::Greater => 1,
            std::cmp::Ordering::Less => 2,
        }
    }
}

/// Where a layer's packed weights lie.
#[derive(Clone, Copy, Debug)]
struct Packed {
    layer: &'static Layer,
    /// Channels of the first input; those of the second follow.
    first: usize,
    /// First group of 4.
    at: u32,
    /// Output channels with padding.
    outputs: u32,
}

impl Packed {
    fn inputs(&self) -> u32 {
        let second = self.layer.inputs - self.first;
        padded(self.first) + if second == 0 { 0 } else { padded(second) }
    }

    fn quads(&self) -> u32 {
        self.layer.taps as u32 * self.inputs() * self.outputs / 4
    }
}

/// The layers with the channels of their first input.
const LAYERS: [(&Layer, usize); 9] = [
    (&layers::ENC1, INPUT),
    (&layers::ENC2, INPUT),
    (&layers::ENC3, HALF),
    (&layers::UP2, QUARTER),
    (&layers::DEC2, HALF),
    (&layers::UP1, HALF),
    (&layers::DEC1, INPUT),
    (&layers::FUSE, INPUT),
    (&layers::FINAL, INPUT),
];

/// Memory for images of one size.
#[derive(Debug)]
pub struct HalfHourglass {
    units: MatrixUnits,
    packed: Buffer,
    layers: [Packed; 9],
    x: Map,
    e1: Map,
    e2: Map,
    b: Map,
    u2: Map,
    d2: Map,
    u1: Map,
    d1: Map,
}

impl HalfHourglass {
    /// Memory for images of `width` x `height` pixels, 434 bytes a pixel; none where the adapter has no matrix units.
    ///
    /// # Errors
    /// Not enough memory, or more than the device binds at once.
    pub fn new(gpu: &Gpu, width: u32, height: u32) -> Result<Option<Self>, GpuError> {
        let Some(units) = gpu.matrix_units else { return Ok(None) };
        let mut at = 0;
        let layers = LAYERS.map(|(layer, first)| {
            let outputs = match layer.name == layers::FINAL.name {
                true => units.side,
                false if layer.taps == 1 => padded(layer.outputs),
                false => (layer.outputs as u32).next_multiple_of(3 * units.side),
            };
            let packed = Packed { layer, first, at, outputs };
            at += packed.quads();
            packed
        });
        let [full, half, quarter] = [1, 2, 4].map(|s| [width / s, height / s]);
        let map = |what, channels, size| Map::new(gpu, what, channels, size);
        let packed = gpu.allocate("packed weights", 8 * u64::from(at))?;
        Ok(Some(Self {
            units,
            packed,
            layers,
            x: map("hourglass x", INPUT, full)?,
            e1: map("hourglass e1", INPUT, full)?,
            e2: map("hourglass e2", HALF, half)?,
            b: map("hourglass b", QUARTER, quarter)?,
            u2: map("hourglass u2", HALF, half)?,
            d2: map("hourglass d2", HALF, half)?,
            u1: map("hourglass u1", INPUT, full)?,
            d1: map("hourglass d1", INPUT, full)?,
        }))
    }

    /// From `planes` (`[38][height * width]` in float32) to `residual` (`[height * width * 3]`). `weights`: the network's
    /// flat weights ([`layers`]).
    pub fn forward(&self, pass: &mut Pass, weights: &Buffer, planes: &Buffer, residual: &Buffer) {
        self.pack(pass, weights, planes);
        let Self { x, e1, e2, b, u2, d2, u1, d1, .. } = self;
        let steps: [(&[&Map], &Map); 7] =
            [(&[x], e1), (&[e1], e2), (&[e2], b), (&[b], u2), (&[u2, e2], d2), (&[d2], u1), (&[u1, e1], d1)];
        for (packed, (inputs, output)) in self.layers.iter().zip(steps) {
            self.conv(pass, weights, packed, inputs, output);
        }
        let [fuse, last] = [self.layers[7], self.layers[8]];
        let pixels = x.size[0] * x.size[1];
        let params = HalfHeadParams {
            pixels,
            fuse_bias: fuse.layer.bias() as u32,
            fuse: fuse.at,
            last_bias: last.layer.bias() as u32,
            last: last.at,
        };
        let groups = pixels.div_ceil(SUBGROUPS * self.units.side) as usize;
        let buffers = [weights, &self.packed, &d1.buffer, &x.buffer, residual];
        pass.groups(&HALF_HEAD, &buffers, bytes_of(&params), groups);
    }

    fn pack(&self, pass: &mut Pass, weights: &Buffer, planes: &Buffer) {
        let pixels = self.x.size[0] * self.x.size[1];
        let params = HalfPackParams { pixels, channels: INPUT as u32, quads: self.x.quads() };
        pass.linear(&HALF_PACK, &[planes, &self.x.buffer], bytes_of(&params), pixels as usize);
        for packed in &self.layers {
            let layer = packed.layer;
            let params = HalfWeightsParams {
                weights: layer.offset as u32,
                taps: layer.taps as u32,
                channels_a: packed.first as u32,
                padded_a: padded(packed.first),
                channels_b: (layer.inputs - packed.first) as u32,
                padded: packed.inputs(),
                outputs: layer.outputs as u32,
                quads: packed.outputs / 4,
                into: packed.at,
            };
            pass.linear(&HALF_WEIGHTS, &[weights, &self.packed], bytes_of(&params), packed.quads() as usize);
        }
    }

    fn conv(&self, pass: &mut Pass, weights: &Buffer, packed: &Packed, inputs: &[&Map], output: &Map) {
        let (a, b) = (inputs[0], inputs.get(1).copied());
        assert_eq!(a.channels, packed.first, "{}: inputs", packed.layer.name);
        let side = self.units.side;
        let params = HalfConvParams {
            size: output.size,
            source: a.size,
            mode: a.mode(output.size),
            quads_a: a.quads(),
            quads_b: b.map_or(0, Map::quads),
            quads_out: output.quads(),
            outputs: output.channels as u32,
            bias: packed.layer.bias() as u32,
            packed: packed.at,
            packed_quads: packed.outputs / 4,
        };
        let grid = [output.size[0].div_ceil(side), output.size[1].div_ceil(ROWS), packed.outputs / (3 * side)];
        let buffers = [weights, &self.packed, &a.buffer, &b.unwrap_or(a).buffer, &output.buffer];
        pass.grid(&HALF_CONV, &buffers, bytes_of(&params), grid);
    }
}
