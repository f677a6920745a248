//! The U-Net's activations: how they lie in memory, and which of them share it.

use super::Arithmetic;
use crate::gpu::{Buffer, Gpu, GpuError};
use crate::raster::Keep;
use crate::residual::layers::{HALF, INPUT, QUARTER};
use half::f16;
use ibgs_shaders::types::{F16, Pair};

/// Channels with padding, in half precision.
pub(super) fn padded(channels: usize) -> u32 {
    (channels as u32).next_multiple_of(16)
}

/// An activation or its gradient.
#[derive(Clone, Debug)]
pub(super) struct Map {
    memory: Memory,
    pub channels: usize,
    /// Width and height in pixels.
    pub size: [u32; 2],
}

#[derive(Clone, Debug)]
enum Memory {
    /// Float32, `[channel][row][column]`.
    Planes(Buffer<f32>),
    /// Halves of two channels a word, `[channel / 2][row][column]`.
    Words(Buffer<u32>),
    /// Half precision, channels last and padded to a multiple of 16, `[row][column][channel]`, four channels a row of the
    /// buffer.
    Halves(Buffer<[F16; 4]>),
}

/// Rows of the buffer of an activation of `size` pixels.
fn rows(arithmetic: Arithmetic, channels: usize, size: [u32; 2]) -> usize {
    let pixels = size[0] as usize * size[1] as usize;
    match arithmetic {
        Arithmetic::Full => channels * pixels,
        Arithmetic::Packed => channels.div_ceil(2) * pixels,
        // Room for whole matrices behind the last pixel.
        Arithmetic::Half => padded(channels) as usize / 4 * pixels.next_multiple_of(16),
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
        let rows = rows(arithmetic, channels, size);
        let memory = match arithmetic {
            Arithmetic::Full => Memory::Planes(gpu.allocate(what, rows)?),
            Arithmetic::Packed => Memory::Words(gpu.allocate(what, rows)?),
            Arithmetic::Half => Memory::Halves(gpu.allocate(what, rows)?),
        };
        Ok(Self { memory, channels, size })
    }

    /// Another activation in the same memory, from row `at` of the buffer on.
    pub fn reuse(&self, channels: usize, size: [u32; 2], at: usize) -> Self {
        let rows = rows(self.arithmetic(), channels, size);
        let (memory, has) = match &self.memory {
            Memory::Planes(planes) => (Memory::Planes(planes.part(at, rows)), planes.rows()),
            Memory::Words(words) => (Memory::Words(words.part(at, rows)), words.rows()),
            Memory::Halves(halves) => (Memory::Halves(halves.part(at, rows)), halves.rows()),
        };
        assert!(at + rows <= has, "an activation does not fit its memory");
        Self { memory, channels, size }
    }

    pub fn arithmetic(&self) -> Arithmetic {
        match self.memory {
            Memory::Planes(_) => Arithmetic::Full,
            Memory::Words(_) => Arithmetic::Packed,
            Memory::Halves(_) => Arithmetic::Half,
        }
    }

    /// The planes of one in float32.
    ///
    /// # Panics
    /// When it is in half precision: a bug of ours.
    pub fn planes(&self) -> &Buffer<f32> {
        match &self.memory {
            Memory::Planes(planes) => planes,
            Memory::Words(_) | Memory::Halves(_) => unreachable!("an activation in float32"),
        }
    }

    /// The words of one whose halves are packed.
    ///
    /// # Panics
    /// When it lies otherwise: a bug of ours.
    pub fn words(&self) -> &Buffer<u32> {
        match &self.memory {
            Memory::Words(words) => words,
            Memory::Planes(_) | Memory::Halves(_) => unreachable!("an activation in words"),
        }
    }

    /// The channels of one in half precision, by fours.
    ///
    /// # Panics
    /// When it is in float32: a bug of ours.
    pub fn halves(&self) -> &Buffer<[F16; 4]> {
        match &self.memory {
            Memory::Halves(halves) => halves,
            Memory::Planes(_) | Memory::Words(_) => unreachable!("an activation for matrix units"),
        }
    }

    /// The same by eights, as the matrix units read them.
    ///
    /// # Panics
    /// When it is in float32: a bug of ours.
    pub fn pairs(&self) -> Buffer<Pair> {
        self.halves().cast()
    }

    pub fn pixels(&self) -> u32 {
        self.size[0] * self.size[1]
    }

    /// Writes it from float32 planes, `[channel][row][column]`.
    pub fn write(&self, gpu: &Gpu, planes: &[f32]) {
        let memory = match &self.memory {
            Memory::Planes(memory) => return gpu.write(memory, 0, planes),
            Memory::Words(memory) => memory.cast(),
            Memory::Halves(memory) => memory.cast(),
        };
        let pixels = self.pixels() as usize;
        // Channels that lie side by side, and pixels between those that do not.
        let (side, rows) = match self.memory {
            Memory::Halves(_) => (padded(self.channels) as usize, 0),
            _ => (2, pixels),
        };
        let mut halves = vec![F16::default(); self.channels.next_multiple_of(side) * pixels];
        for (channel, plane) in planes.chunks_exact(pixels).enumerate() {
            let first = channel / side * side * rows + channel % side;
            plane.iter().enumerate().for_each(|(p, v)| halves[first + p * side] = F16(f16::from_f32(*v).to_bits()));
        }
        gpu.write::<F16>(&memory, 0, &halves);
    }

    /// Reads one in half precision as float32 planes, `[channel][row][column]`.
    pub fn read_halves(&self, gpu: &Gpu) -> Result<Vec<f32>, GpuError> {
        let channels = padded(self.channels) as usize;
        let halves = gpu.read(self.halves(), channels / 4 * self.pixels() as usize)?.into_flattened();
        let planes = (0..self.channels).flat_map(|channel| halves[channel..].iter().step_by(channels));
        Ok(planes.map(|value| f16::from_bits(value.0).to_f32()).collect())
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
    /// `[height * width, 4]`.
    pub residual: Buffer<[f32; 4]>,
    /// Whether f is kept.
    pub keep: Keep,
}

impl Activations {
    pub fn new(gpu: &Gpu, arithmetic: Arithmetic, full: [u32; 2], keep: Keep) -> Result<Self, GpuError> {
        let [half, quarter] = [2, 4].map(|s| full.map(|side| side / s));
        let map = |what, channels, size| Map::new(gpu, what, arithmetic, channels, size);
        let (x, e1) = (map("unet x", INPUT, full)?, map("unet e1", INPUT, full)?);
        let (u1, d1) = (map("unet u1", INPUT, full)?, map("unet d1", INPUT, full)?);
        let residual = gpu.allocate("residual", x.pixels() as usize)?;
        if arithmetic != Arithmetic::Half && keep == Keep::Image {
            // What a layer reads never lies in the buffer that it writes: e2, u2 and then u1 share one, b, d2, d1 the
            // other.
            let alignment = gpu.limits.min_storage_buffer_offset_alignment as usize / size_of::<f32>();
            let e2 = u1.reuse(HALF, half, 0);
            let u2 = u1.reuse(HALF, half, rows(arithmetic, HALF, half).next_multiple_of(alignment));
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
    pub partials: Buffer<f32>,
}

impl Gradients {
    pub fn new(gpu: &Gpu, maps: &Activations, partials: usize) -> Result<Self, GpuError> {
        let like = |what, map: &Map| Map::new(gpu, what, map.arithmetic(), map.channels, map.size);
        Ok(Self {
            v_e1: like("unet v_e1", &maps.e1)?,
            v_e2: like("unet v_e2", &maps.e2)?,
            partials: gpu.allocate("weight gradients", partials)?,
        })
    }
}
