//! The U-Net's activations: how they lie in memory, and which of them share it.

use super::Arithmetic;
use crate::gpu::{Buffer, Gpu, GpuError};
use crate::raster::Keep;
use crate::residual::layers::{HALF, INPUT, OUTPUTS, QUARTER};
use half::f16;
use half::slice::HalfFloatSliceExt;

/// Channels with padding, in half precision.
pub(super) fn padded(channels: usize) -> u32 {
    (channels as u32).next_multiple_of(16)
}

/// An activation or its gradient. In float32 planes, `[channel][row][column]`; in half precision channels last and padded
/// to a multiple of 16, `[row][column][channel]`.
#[derive(Clone, Debug)]
pub(super) struct Map {
    pub buffer: Buffer,
    pub channels: usize,
    /// Width and height in pixels.
    pub size: [u32; 2],
    pub arithmetic: Arithmetic,
}

/// Bytes of an activation of `size` pixels.
fn bytes(arithmetic: Arithmetic, channels: usize, size: [u32; 2]) -> u64 {
    let pixels = u64::from(size[0]) * u64::from(size[1]);
    match arithmetic {
        Arithmetic::Full => 4 * channels as u64 * pixels,
        // Room for whole matrices behind the last pixel.
        Arithmetic::Half => 2 * u64::from(padded(channels)) * pixels.next_multiple_of(16),
    }
}

impl Map {
    pub fn new(
        gpu: &Gpu,
        what: &'static str,
        arithmetic: Arithmetic,
        channels: usize,
        size: [u32; 2],
    ) -> Result<Self, GpuError> {
        let buffer = gpu.allocate(what, bytes(arithmetic, channels, size))?;
        Ok(Self { buffer, channels, size, arithmetic })
    }

    /// Another activation in the same memory, from byte `at` on.
    pub fn reuse(&self, channels: usize, size: [u32; 2], at: u64) -> Self {
        let bytes = bytes(self.arithmetic, channels, size);
        assert!(at + bytes <= self.buffer.size, "an activation does not fit its memory");
        Self { buffer: self.buffer.part(at, bytes), channels, size, arithmetic: self.arithmetic }
    }

    pub fn pixels(&self) -> u32 {
        self.size[0] * self.size[1]
    }

    /// Writes it from float32 planes, `[channel][row][column]`.
    pub fn write(&self, gpu: &Gpu, planes: &[f32]) {
        let write = |bytes: &[u8]| gpu.queue.write_buffer(&self.buffer.buffer, self.buffer.offset, bytes);
        if self.arithmetic == Arithmetic::Full {
            return write(bytemuck::cast_slice(planes));
        }
        let (pixels, channels) = (self.pixels() as usize, padded(self.channels) as usize);
        let mut halves = vec![f16::ZERO; pixels * channels];
        for (channel, plane) in planes.chunks_exact(pixels).enumerate() {
            plane.iter().enumerate().for_each(|(p, v)| halves[p * channels + channel] = f16::from_f32(*v));
        }
        write(bytemuck::cast_slice(halves.reinterpret_cast()));
    }
}

/// The activations of one image size, input and output included.
#[derive(Debug)]
pub(super) struct Activations {
    pub x: Map,
    pub e1: Map,
    pub e2: Map,
    pub b: Map,
    pub u2: Map,
    pub d2: Map,
    pub u1: Map,
    pub d1: Map,
    /// The last layer's input; after the backward pass the gradient by x. A stub without gradients.
    pub f: Map,
    /// Float32, `[height * width * 4]`.
    pub residual: Buffer,
    /// Whether f is kept.
    pub keep: Keep,
}

impl Activations {
    pub fn new(gpu: &Gpu, arithmetic: Arithmetic, full: [u32; 2], keep: Keep) -> Result<Self, GpuError> {
        let [half, quarter] = [2, 4].map(|s| full.map(|side| side / s));
        let map = |what, channels, size| Map::new(gpu, what, arithmetic, channels, size);
        let (x, e1) = (map("unet x", INPUT, full)?, map("unet e1", INPUT, full)?);
        let (u1, d1) = (map("unet u1", INPUT, full)?, map("unet d1", INPUT, full)?);
        let residual = gpu.allocate("residual", 4 * OUTPUTS as u64 * u64::from(x.pixels()))?;
        if (arithmetic, keep) == (Arithmetic::Full, Keep::Image) {
            // What a layer reads never lies in the buffer that it writes: e2, u2 and then u1 share one, b, d2, d1 the
            // other.
            let alignment = u64::from(gpu.limits.min_storage_buffer_offset_alignment);
            let e2 = u1.reuse(HALF, half, 0);
            let u2 = u1.reuse(HALF, half, e2.buffer.size.next_multiple_of(alignment));
            let (b, d2) = (d1.reuse(QUARTER, quarter, 0), d1.reuse(HALF, half, 0));
            let f = map("unet f", 0, full)?;
            return Ok(Self { x, e1, e2, b, u2, d2, u1, d1, f, residual, keep });
        }
        let (e2, b) = (map("unet e2", HALF, half)?, map("unet b", QUARTER, quarter)?);
        let (u2, d2) = (map("unet u2", HALF, half)?, map("unet d2", HALF, half)?);
        let f = map("unet f", INPUT, if keep == Keep::Gradients { full } else { [1, 1] })?;
        Ok(Self { x, e1, e2, b, u2, d2, u1, d1, f, residual, keep })
    }
}

/// What only the backward pass needs. Most gradients take the place of the activation whose ReLU they have passed.
#[derive(Debug)]
pub(super) struct Gradients {
    pub v_e1: Map,
    pub v_e2: Map,
    /// Partial sums of one layer's weight gradient, the layers by turns.
    pub partials: Buffer,
}

impl Gradients {
    pub fn new(gpu: &Gpu, maps: &Activations, partial_bytes: u64) -> Result<Self, GpuError> {
        let like = |what, map: &Map| Map::new(gpu, what, map.arithmetic, map.channels, map.size);
        Ok(Self {
            v_e1: like("unet v_e1", &maps.e1)?,
            v_e2: like("unet v_e2", &maps.e2)?,
            partials: gpu.allocate("weight gradients", partial_bytes)?,
        })
    }
}
