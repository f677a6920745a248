//! The final colour from base colour, sources and the network's output (method.md section 6), and its derivative.

use super::variant::Variant;
use crate::gpu::{Buffer, Pass};
use crate::sources::Reach;
use ibgs_shaders::bindings::{ResidualComposeBackwardBindings, ResidualComposeBindings};
use ibgs_shaders::types::ComposeParams;

/// `gain base + residual`, or the network's colour alone; the network's output is resized with corners aligned. With
/// [`Output::Gated`](super::Output::Gated) (a departure from method.md)
///
/// ```text
/// C' = gain C + residual + g D,   g the sigmoid of the fourth output
/// D  = sum w_m (c_m - C) / (0.05 + sum w_m)
/// w_m = exp(-e_m^2 / 2 - (1 - cos_m) / 0.05)          e_m the error of the depth in units of what agrees
/// ```
///
/// Where no source is seen in the whole image there is no network output: `gain base`, or `base` where the network gives colours.
/// With [`Reach::Seen`] pixels that see no source have `base`.
#[derive(Clone, Copy, Debug)]
pub struct Compose {
    params: ComposeParams,
}

/// What the composition and its derivative read. P pixels of the image, n of the network's size.
#[derive(Clone, Copy, Debug)]
pub struct ComposeInputs<'a> {
    /// `[4]` words, the first: most visible sources of any pixel.
    pub most_visible: &'a Buffer<u32>,
    /// Which sources the pixels see, `[P]` u32 as in [`Seen::visible`](crate::sources::Seen::visible).
    pub seen: &'a Buffer<u32>,
    /// Base colour, `[P, 3]`.
    pub base: &'a Buffer<f32>,
    /// `[V][P]` of (colour of the visible source, cosine).
    pub warped: &'a Buffer<[f32; 4]>,
    /// The network's output, `[n, 4]`.
    pub residual: &'a Buffer<[f32; 4]>,
}

/// The gradients of the composition.
#[derive(Clone, Copy, Debug)]
pub struct ComposeGradients<'a> {
    /// Gradient by the final colour, `[P, 3]`, read.
    pub v_image: &'a Buffer<f32>,
    /// `[n, 4]`, assigned; zero where no source is seen in the whole image.
    pub v_residual: &'a Buffer<[f32; 4]>,
    /// `[P, 3]`, assigned; without the part that passes through D.
    pub v_base: &'a Buffer<f32>,
}

impl Compose {
    /// The composition for an image of `size` (width, height) that sees up to `visible` sources; `gain` is the base colour's factor
    /// during burn-in, else 1.
    pub fn new(size: [u32; 2], visible: u32, variant: Variant, gain: f32) -> Self {
        let (low, output) = (variant.factor.size(size), variant.output as u32);
        let seen_only = u32::from(variant.reach == Reach::Seen);
        Self { params: ComposeParams { size, low, gain, output, seen_only, visible } }
    }

    /// Records the final colour, `[P, 3]`, into `image`.
    pub fn record(&self, pass: &mut Pass<'_>, inputs: &ComposeInputs<'_>, image: &Buffer<f32>) {
        let ComposeInputs { most_visible, seen, base, warped, residual } = *inputs;
        let [width, height] = self.params.size;
        let pixels = (width * height) as usize;
        let bindings = ResidualComposeBindings { most_visible, seen, base, warped, residual, image };
        pass.linear(&bindings, &self.params, pixels);
    }

    /// Records the gradients by the network's output and the base colour; those through D by the sources' colours are the features'.
    pub fn record_backward(&self, pass: &mut Pass<'_>, inputs: &ComposeInputs<'_>, gradients: &ComposeGradients<'_>) {
        let ComposeInputs { most_visible, seen, base, warped, residual } = *inputs;
        let ComposeGradients { v_image, v_residual, v_base } = *gradients;
        let ComposeParams { size, low, .. } = self.params;
        let items = (size[0] * size[1]).max(low[0] * low[1]) as usize;
        let bindings =
            ResidualComposeBackwardBindings { most_visible, seen, base, warped, residual, v_image, v_residual, v_base };
        pass.linear(&bindings, &self.params, items);
    }
}
