//! The U-Net of the residual network: 38 planes in, the residual out, and back (method.md section 6).
//!
//! Every layer is one kernel launch. Concatenations, the 2 x 2 maxima and the enlargements by nearest are never stored:
//! the next convolution reads through them. Activations are planes, `[channel][row][column]`.
//!
//! Memory in bytes a pixel, the input and the residual included: 620 for rendering (x, e1, the residual, and two more
//! buffers of 38 planes that the other activations share by turns), 1003 with gradients (x, e1, u1, d1, v_e1, and f with
//! v_x in its place; gradients replace the activations whose ReLU they have passed). With gradients up to 14 MB more for
//! partial sums of the weights' gradients, whatever the size.

mod backward;

use super::layers::{self, HALF, INPUT, Layer, QUARTER};
use crate::gpu::{Buffer, Gpu, GpuError, Pass};
use crate::raster::Keep;
use bytemuck::bytes_of;
use ibgs_shaders::types::{ConvParams, HeadParams};
use ibgs_shaders::{RESIDUAL_CONV, RESIDUAL_HEAD};

/// Smallest width and height: a quarter of it is one pixel.
pub const MIN_SIDE: u32 = 4;

/// Columns of a convolution's workgroup, and rows of one of its row groups.
const CONV_TILE: [u32; 2] = [32, 8];
/// Outputs a thread of a convolution owns.
const CONV_OUTPUTS: u32 = 20;
/// Pixels of a workgroup of the head.
const HEAD_PIXELS: usize = 512;

/// How a convolution reads its input; as in `shared/residual_source.wgsl`.
#[derive(Clone, Copy)]
pub(super) enum Mode {
    Same,
    Pooled,
    Nearest,
}

impl Mode {
    /// For an input of size `source` and a convolution of size `size`.
    pub(super) fn of(source: [u32; 2], size: [u32; 2]) -> Self {
        match source[0].cmp(&size[0]) {
            std::cmp::Ordering::Equal => Self::Same,
            std::cmp::Ordering::Greater => Self::Pooled,
            std::cmp::Ordering::Less => Self::Nearest,
        }
    }
}

/// What becomes of a convolution's sums; as in `residual_conv.wgsl` and `half_conv.wgsl`.
#[derive(Clone, Copy)]
pub(super) enum Store {
    Relu,
    Assign,
    Add,
    Mask,
}

/// Planes of one size, `[channels][height * width]`.
#[derive(Clone, Debug)]
struct Map {
    buffer: Buffer,
    channels: u32,
    size: [u32; 2],
}

/// What only the backward pass needs.
#[derive(Debug)]
struct Training {
    v_e1: Map,
    v_e2: Map,
    partials: Buffer,
}

/// The activations of one image size. The kernels' launches go into the caller's [`Pass`].
#[derive(Debug)]
pub struct UNet {
    x: Map,
    e1: Map,
    e2: Map,
    b: Map,
    u2: Map,
    d2: Map,
    u1: Map,
    d1: Map,
    /// f after `forward`, v_x after `backward`; a stub without gradients.
    kept: Map,
    residual: Buffer,
    training: Option<Training>,
}

impl Map {
    fn bytes(channels: usize, size: [u32; 2]) -> u64 {
        4 * channels as u64 * u64::from(size[0]) * u64::from(size[1])
    }

    fn new(gpu: &Gpu, what: &'static str, channels: usize, size: [u32; 2]) -> Result<Self, GpuError> {
        let buffer = gpu.allocate(what, Self::bytes(channels, size))?;
        Ok(Self { buffer, channels: channels as u32, size })
    }

    /// Other planes in the same memory, from byte `at` on.
    fn reuse(&self, channels: usize, size: [u32; 2], at: u64) -> Self {
        let bytes = Self::bytes(channels, size);
        assert!(at + bytes <= self.buffer.size, "planes do not fit their memory");
        let buffer = self.buffer.part(at, bytes);
        Self { buffer, channels: channels as u32, size }
    }

    fn pixels(&self) -> usize {
        self.size[0] as usize * self.size[1] as usize
    }

    /// How a convolution of size `size` reads these planes.
    fn mode(&self, size: [u32; 2]) -> Mode {
        Mode::of(self.size, size)
    }
}

/// Workgroups of a convolution with `outputs` outputs, and its groups of outputs.
fn conv_grid(size: [u32; 2], outputs: u32) -> ([u32; 3], u32) {
    let groups = outputs.div_ceil(CONV_OUTPUTS);
    assert!((1..=2).contains(&groups), "one launch has at most 40 outputs");
    ([size[0].div_ceil(CONV_TILE[0]), size[1].div_ceil(CONV_TILE[1] * 4 / groups), 1], groups)
}

/// A layer over one or two inputs (two: their concatenation), with ReLU.
fn conv(pass: &mut Pass, weights: &Buffer, layer: &Layer, inputs: &[&Map], output: &Map) {
    let (a, b) = (inputs[0], inputs.get(1).copied());
    let channels_b = b.map_or(0, |m| m.channels);
    assert_eq!((a.channels + channels_b) as usize, layer.inputs, "{}: inputs", layer.name);
    let (grid, groups) = conv_grid(output.size, output.channels);
    let params = ConvParams {
        size: output.size,
        source: a.size,
        mode: a.mode(output.size) as u32,
        channels_a: a.channels,
        channels_b,
        outputs: output.channels,
        weights: layer.offset as u32,
        stride_out: 9 * layer.inputs as u32,
        stride_in: 9,
        turned: 0,
        bias: layer.bias() as u32,
        store: Store::Relu as u32,
        groups,
        pad: 0,
    };
    let buffers = [weights, &a.buffer, &b.unwrap_or(a).buffer, &output.buffer];
    pass.grid(&RESIDUAL_CONV, &buffers, bytes_of(&params), grid);
}

impl UNet {
    /// Memory for images of `width` x `height` pixels. With `gradients` every activation is kept for
    /// [`UNet::backward`]; without, they share the smallest memory.
    ///
    /// # Errors
    /// Not enough memory, or more than the device binds at once.
    ///
    /// # Panics
    /// When a side is shorter than [`MIN_SIDE`]: so small an image has no residual, see [`UNet::fits`].
    pub fn new(gpu: &Gpu, width: u32, height: u32, keep: Keep) -> Result<Self, GpuError> {
        let gradients = keep == Keep::Gradients;
        assert!(Self::fits([width, height]), "the unet needs at least {MIN_SIDE} x {MIN_SIDE} pixels");
        let [full, half, quarter] = [1, 2, 4].map(|s| [width / s, height / s]);
        let map = |what, channels, size| Map::new(gpu, what, channels, size);
        let x = map("unet x", INPUT, full)?;
        let e1 = map("unet e1", INPUT, full)?;
        let residual = gpu.allocate("residual", Map::bytes(3, full))?;
        let u1 = map("unet u1", INPUT, full)?;
        let d1 = map("unet d1", INPUT, full)?;
        if gradients {
            let (e2, b) = (map("unet e2", HALF, half)?, map("unet b", QUARTER, quarter)?);
            let (u2, d2) = (map("unet u2", HALF, half)?, map("unet d2", HALF, half)?);
            let kept = map("unet f", INPUT, full)?;
            let training = Some(Training {
                v_e1: map("unet v_e1", INPUT, full)?,
                v_e2: map("unet v_e2", HALF, half)?,
                partials: gpu.allocate("weight gradients", backward::partial_bytes(full))?,
            });
            return Ok(Self { x, e1, e2, b, u2, d2, u1, d1, kept, residual, training });
        }
        // What a layer reads never lies in the buffer that it writes: e2, u2 and then u1 share one, b, d2, d1 the other.
        let alignment = u64::from(gpu.limits.min_storage_buffer_offset_alignment);
        let e2 = u1.reuse(HALF, half, 0);
        let u2 = u1.reuse(HALF, half, Map::bytes(HALF, half).next_multiple_of(alignment));
        let (b, d2) = (d1.reuse(QUARTER, quarter, 0), d1.reuse(HALF, half, 0));
        let kept = map("unet f", 0, full)?;
        Ok(Self { x, e1, e2, b, u2, d2, u1, d1, kept, residual, training: None })
    }

    /// Whether an image of this size is large enough.
    pub fn fits(size: [u32; 2]) -> bool {
        size.iter().all(|side| *side >= MIN_SIDE)
    }

    /// Width and height in pixels.
    pub fn size(&self) -> [u32; 2] {
        self.x.size
    }

    /// Whether [`UNet::backward`] can run.
    pub fn has_gradients(&self) -> bool {
        self.training.is_some()
    }

    /// The input, `[38][height * width]`, for the caller to write.
    pub fn x(&self) -> &Buffer {
        &self.x.buffer
    }

    /// The output of [`UNet::forward`], `[height * width * 3]`.
    pub fn residual(&self) -> &Buffer {
        &self.residual
    }

    /// From x to the residual. `weights`: the network's flat weights ([`layers`]).
    pub fn forward(&self, pass: &mut Pass, weights: &Buffer) {
        let Self { x, e1, e2, b, u2, d2, u1, d1, .. } = self;
        conv(pass, weights, &layers::ENC1, &[x], e1);
        conv(pass, weights, &layers::ENC2, &[e1], e2);
        conv(pass, weights, &layers::ENC3, &[e2], b);
        conv(pass, weights, &layers::UP2, &[b], u2);
        conv(pass, weights, &layers::DEC2, &[u2, e2], d2);
        conv(pass, weights, &layers::UP1, &[d2], u1);
        conv(pass, weights, &layers::DEC1, &[u1, e1], d1);
        let buffers = [weights, &d1.buffer, &x.buffer, &self.residual, &self.kept.buffer];
        pass.groups(&RESIDUAL_HEAD, &buffers, bytes_of(&self.head_params()), x.pixels().div_ceil(HEAD_PIXELS));
    }

    fn head_params(&self) -> HeadParams {
        HeadParams {
            pixels: self.x.pixels() as u32,
            fuse: layers::FUSE.offset as u32,
            fuse_bias: layers::FUSE.bias() as u32,
            last: layers::FINAL.offset as u32,
            last_bias: layers::FINAL.bias() as u32,
            keep: u32::from(self.has_gradients()),
        }
    }
}
