//! The U-Net of the residual network: 38 channels in, the output of four out, and back (method.md section 6).
//!
//! This file has the schedule: which layer reads and writes which activation, and where each gradient goes. Two backends
//! have the layers: one computes in float32, the other in half precision on matrix units.
//!
//! Concatenations, the 2 x 2 maxima and the enlargements by nearest are never stored: the next convolution reads through
//! them.
//!
//! Memory in bytes a pixel, the input and the output included:
//!
//! - Float32: 624 for rendering (x, e1, the output, and two more buffers of 38 planes that the other activations share
//!   by turns), 1007 with gradients (x, e1, u1, d1, v_e1, and f with v_x in its place; gradients replace the activations
//!   whose ReLU they have passed), and up to 14 MB for partial sums of the weights' gradients, whatever the size.
//! - Float32 with activations as halves: 320 for rendering.
//! - Half precision: 450 for rendering, 732 with gradients, partial sums besides.

mod backend;
pub mod choice;
mod full;
mod half;
mod memory;

use super::features::{FeatureInputs, Features, GradientByX};
use super::layers::{DEC1, DEC2, ENC1, ENC2, ENC3, INPUT, Layer, Part, UP1, UP2};
use crate::gpu::{Buffer, Gpu, GpuError, Pass};
use crate::raster::Keep;
use backend::{Backend, BackwardBuffers};
use full::Full;
use half::Half;
use ibgs_shaders::Store;
use memory::{Activations, Gradients, Map};
use std::ops::Range;

/// Smallest width and height: a quarter of it is one pixel.
pub const MIN_SIDE: u32 = 4;

/// What the U-Net computes with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arithmetic {
    /// Float32, on any adapter.
    Full,
    /// The same with activations as halves, two a word; with gradients as `Full`.
    Packed,
    /// Half precision on matrix units, summed in float32; float32 where the adapter has none.
    Half,
}

/// The activations of one image size. The kernels' launches go into the caller's [`Pass`].
#[derive(Debug)]
pub struct UNet {
    backend: Box<dyn Backend>,
    maps: Activations,
    gradients: Option<Gradients>,
    /// Float32 planes of the gradient by [`plane_channels`] of the input; a stub without gradients.
    v_planes: Buffer<f32>,
}

impl UNet {
    /// Memory for images of a size in pixels. Where gradients are kept, every activation is, for [`UNet::backward`].
    ///
    /// # Errors
    /// Not enough memory, or more than the device binds at once.
    ///
    /// # Panics
    /// When a side is shorter than [`MIN_SIDE`]: so small an image has no residual, see [`UNet::fits`].
    pub fn new(gpu: &Gpu, size: [u32; 2], keep: Keep, arithmetic: Arithmetic) -> Result<Self, GpuError> {
        assert!(Self::fits(size), "the unet needs at least {MIN_SIDE} x {MIN_SIDE} pixels");
        let units = gpu.matrix_units.filter(|_| arithmetic == Arithmetic::Half);
        let (arithmetic, backend): (_, Box<dyn Backend>) = match units {
            Some(units) => (Arithmetic::Half, Box::new(Half::new(gpu, units, size, keep)?)),
            None if (arithmetic, keep) == (Arithmetic::Packed, Keep::Image) => (arithmetic, Box::new(Full::new(gpu))),
            None => (Arithmetic::Full, Box::new(Full::new(gpu))),
        };
        let maps = Activations::new(gpu, arithmetic, size, keep)?;
        let gradients = match keep {
            Keep::Gradients => Some(Gradients::new(gpu, &maps, backend.partials(size))?),
            Keep::Image => None,
        };
        let v_planes = match arithmetic {
            Arithmetic::Full => maps.f.planes().clone(),
            Arithmetic::Packed | Arithmetic::Half => {
                let pixels = if keep == Keep::Gradients { maps.x.pixels() } else { 1 };
                gpu.allocate("unet v_x", plane_channels(&*backend).len() * pixels as usize)?
            }
        };
        Ok(Self { backend, maps, gradients, v_planes })
    }

    /// Whether an image of this size is large enough.
    pub fn fits(size: [u32; 2]) -> bool {
        size.iter().all(|side| *side >= MIN_SIDE)
    }

    /// Width and height in pixels.
    pub fn size(&self) -> [u32; 2] {
        self.maps.x.size
    }

    /// Whether [`UNet::backward`] can run.
    pub fn has_gradients(&self) -> bool {
        self.gradients.is_some()
    }

    /// The input in float32, to be written before every pass: planes, `[38][height * width]`.
    ///
    /// # Panics
    /// In half precision: a bug of ours.
    pub fn x(&self) -> &Buffer<f32> {
        self.maps.x.planes()
    }

    /// Records the input: float32 planes, words of two halves, or halves with channels last, `[height * width][48]`.
    pub fn record_input(&self, pass: &mut Pass, features: &Features, inputs: &FeatureInputs) {
        let x = &self.maps.x;
        match x.arithmetic() {
            Arithmetic::Full => features.record(pass, inputs, x.planes()),
            Arithmetic::Packed => features.record_packed(pass, inputs, x.words()),
            Arithmetic::Half if self.backend.multiplies_features() => {
                features.record_on_units(pass, inputs, x.halves());
            }
            Arithmetic::Half => features.record_half(pass, inputs, x.halves()),
        }
    }

    /// Writes the input from planes, `[38][height * width]`.
    pub fn write_input(&self, gpu: &Gpu, planes: &[f32]) {
        self.maps.x.write(gpu, planes);
    }

    /// The output of [`UNet::forward`], `[height * width, 4]`: the residual, and the gate before its sigmoid.
    pub fn residual(&self) -> &Buffer<[f32; 4]> {
        &self.maps.residual
    }

    /// The gradient by the input after [`UNet::backward`].
    pub fn v_x(&self) -> GradientByX<'_> {
        match self.backend.unscale() {
            Some(unscale) => GradientByX::Halves { all: self.maps.f.halves(), unscale, base: &self.v_planes },
            None => GradientByX::Planes(&self.v_planes),
        }
    }

    /// The same read back, `[38][height * width]`.
    ///
    /// # Errors
    /// The device is lost.
    pub fn read_v_x(&self, gpu: &Gpu) -> Result<Vec<f32>, GpuError> {
        match self.backend.unscale() {
            Some(unscale) => Ok(self.maps.f.read_halves(gpu)?.into_iter().map(|v| unscale * v).collect()),
            None => gpu.read(&self.v_planes, INPUT * self.maps.x.pixels() as usize),
        }
    }

    /// From the input to the output. `weights`: the network's flat weights ([`layers`](super::layers)).
    pub fn forward(&self, pass: &mut Pass, weights: &Buffer<f32>) {
        let Activations { x, e1, e2, b, u2, d2, u1, d1, .. } = &self.maps;
        self.backend.prepare(pass, weights);
        let mut conv = |layer: &Layer, inputs: &[&Map], output: &Map| {
            let channels = inputs.iter().map(|input| input.channels).sum();
            assert_eq!([channels, output.channels], [layer.inputs, layer.outputs], "{}: channels", layer.name);
            self.backend.conv(pass, weights, layer, inputs, output);
        };
        conv(&ENC1, &[x], e1);
        conv(&ENC2, &[e1], e2);
        conv(&ENC3, &[e2], b);
        conv(&UP2, &[b], u2);
        conv(&DEC2, &[u2, e2], d2);
        conv(&UP1, &[d2], u1);
        conv(&DEC1, &[u1, e1], d1);
        self.backend.head(pass, weights, &self.maps);
    }

    /// From `v_residual`, `[height * width, 4]`, to [`UNet::v_x`] and the U-Net's part of `v_weights` (from the
    /// first weight of e1 to the end), which is assigned; the rest of `v_weights` is left alone.
    ///
    /// Consumes what the last [`UNet::forward`] kept (gradients replace activations): one backward for each forward,
    /// with the same weights. Input and residual stay.
    ///
    /// # Panics
    /// When made without gradients: a bug of ours.
    pub fn backward(
        &self,
        pass: &mut Pass,
        weights: &Buffer<f32>,
        v_residual: &Buffer<[f32; 4]>,
        v_weights: &Buffer<f32>,
    ) {
        let (backend, maps) = (&*self.backend, &self.maps);
        let gradients = self.gradients.as_ref().expect("an unet made with gradients");
        let Activations { x, e1, e2, b, u2, d2, u1, d1, f, .. } = maps;
        let Gradients { v_e1, v_e2, .. } = gradients;
        let buffers = BackwardBuffers { maps, gradients, weights, v_residual, v_weights };
        backend.head_backward(pass, &buffers);
        // From here on d1 holds its gradient and f that of x; below u1, d2, u2 and b come to hold theirs in turn.
        let mut back = Backward { backend, pass, buffers };
        back.concatenated(&DEC1, d1, [u1, e1], v_e1);
        back.enlarged(&UP1, u1, d2);
        back.concatenated(&DEC2, d2, [u2, e2], v_e2);
        back.enlarged(&UP2, u2, b);
        back.pooled(&ENC3, b, e2, v_e2);
        back.pooled(&ENC2, v_e2, e1, v_e1);
        let [all, _] = ENC1.parts();
        back.by_weights(all, v_e1, x);
        back.by_input(all, v_e1, f, Store::Add);
        backend.finish(pass, f, plane_channels(backend), &self.v_planes);
    }
}

/// Channels of the input whose gradient is wanted in float32: those of the base colour where matrix units read the others as halves.
fn plane_channels(backend: &dyn Backend) -> Range<usize> {
    if backend.unscale().is_some() { INPUT - 3..INPUT } else { 0..INPUT }
}

/// A backward pass on its way through the 3 x 3 layers. `v` is the gradient by a layer's output.
struct Backward<'a, 'b, 'c> {
    backend: &'a dyn Backend,
    pass: &'b mut Pass<'c>,
    buffers: BackwardBuffers<'a>,
}

impl Backward<'_, '_, '_> {
    /// Gradient by a part of a layer's weights.
    fn by_weights(&mut self, part: Part, v: &Map, input: &Map) {
        assert_eq!((v.channels, input.channels), (part.layer.outputs, part.channels), "{}: channels", part.layer.name);
        self.backend.weight_gradient(self.pass, &self.buffers, part, v, input);
    }

    /// Gradient by a part of a layer's inputs.
    fn by_input(&mut self, part: Part, v: &Map, v_input: &Map, store: Store) {
        assert_eq!(v.size, v_input.size, "{}: size", part.layer.name);
        self.backend.input_gradient(self.pass, self.buffers.weights, part, v, v_input, store);
    }

    /// The same, of an input that has another size than the layer: into d1's memory, free by then.
    fn by_resized_input(&mut self, part: Part, v: &Map) -> Map {
        let v_input = self.buffers.maps.d1.reuse(part.channels, v.size, 0);
        self.by_input(part, v, &v_input, Store::Assign);
        v_input
    }

    /// A layer that reads two activations: the gradient takes the first one's place. The second is a skip connection,
    /// whose gradient is completed later.
    fn concatenated(&mut self, layer: &'static Layer, v: &Map, [activation, skipped]: [&Map; 2], v_skipped: &Map) {
        let [first, second] = layer.parts();
        self.by_weights(first, v, activation);
        self.by_weights(second, v, skipped);
        self.by_input(second, v, v_skipped, Store::Assign);
        self.by_input(first, v, activation, Store::Mask);
    }

    /// A layer that reads an activation enlarged: the gradient takes its place.
    fn enlarged(&mut self, layer: &'static Layer, v: &Map, activation: &Map) {
        let [all, _] = layer.parts();
        self.by_weights(all, v, activation);
        let v_enlarged = self.by_resized_input(all, v);
        self.backend.upsample_backward(self.pass, &v_enlarged, activation);
    }

    /// A layer that reads an activation's 2 x 2 maxima: completes its gradient.
    fn pooled(&mut self, layer: &'static Layer, v: &Map, activation: &Map, v_activation: &Map) {
        let [all, _] = layer.parts();
        self.by_weights(all, v, activation);
        let v_pooled = self.by_resized_input(all, v);
        self.backend.pool_backward(self.pass, activation, &v_pooled, v_activation);
    }
}
