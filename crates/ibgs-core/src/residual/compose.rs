//! The final colour from base colour and residual (method.md section 6), and its derivative.

use super::variant::{Output, Variant};
use crate::gpu::{Buffer, Pass};
use crate::sources::Reach;
use bytemuck::bytes_of;
use ibgs_shaders::types::ComposeParams;
use ibgs_shaders::{RESIDUAL_COMPOSE, RESIDUAL_COMPOSE_BACKWARD};

/// `gain base + residual`, or the network's colour alone; the network's output is resized with corners aligned. Where no
/// source is seen in the whole image there is no network output: `gain base`, or `base` where the network gives colours. With
/// [`Reach::Seen`] pixels that see no source have `base`.
#[derive(Clone, Copy, Debug)]
pub struct Compose {
    params: ComposeParams,
}

/// What the composition reads and writes. P pixels of the image, n of the network's size.
#[derive(Clone, Copy, Debug)]
pub struct ComposeBuffers<'a> {
    /// `[4]` words, the first: most visible sources of any pixel.
    pub most_visible: &'a Buffer,
    /// Which sources the pixels see, `[P]` u32 as in [`Seen::visible`](crate::sources::Seen::visible).
    pub seen: &'a Buffer,
    /// Base colour, `[P, 3]`.
    pub base: &'a Buffer,
    /// The network's output, `[n, 3]`.
    pub residual: &'a Buffer,
    /// Final colour, `[P, 3]`, written.
    pub image: &'a Buffer,
}

/// What the composition's derivative reads and writes.
#[derive(Clone, Copy, Debug)]
pub struct ComposeGradients<'a> {
    /// As in [`ComposeBuffers`].
    pub most_visible: &'a Buffer,
    /// As in [`ComposeBuffers`].
    pub seen: &'a Buffer,
    /// Gradient by the final colour, `[P, 3]`.
    pub v_image: &'a Buffer,
    /// `[n, 3]`, assigned; zero where no source is seen in the whole image.
    pub v_residual: &'a Buffer,
    /// `[P, 3]`, assigned.
    pub v_base: &'a Buffer,
}

impl Compose {
    /// The composition for an image of `size` (width, height); `gain` is the base colour's factor during burn-in, else 1.
    pub fn new(size: [u32; 2], variant: Variant, gain: f32) -> Self {
        let full_color = u32::from(variant.output == Output::Color);
        let seen_only = u32::from(variant.reach == Reach::Seen);
        let low = variant.factor.size(size);
        Self { params: ComposeParams { size, low, gain, full_color, seen_only, pad: 0 } }
    }

    /// Records the final colour.
    pub fn record(&self, pass: &mut Pass<'_>, buffers: &ComposeBuffers<'_>) {
        let ComposeBuffers { most_visible, seen, base, residual, image } = *buffers;
        let [width, height] = self.params.size;
        let pixels = (width * height) as usize;
        pass.linear(&RESIDUAL_COMPOSE, &[most_visible, seen, base, residual, image], bytes_of(&self.params), pixels);
    }

    /// Records the gradients by residual and base colour.
    pub fn record_backward(&self, pass: &mut Pass<'_>, gradients: &ComposeGradients<'_>) {
        let ComposeGradients { most_visible, seen, v_image, v_residual, v_base } = *gradients;
        let ComposeParams { size, low, .. } = self.params;
        let items = (size[0] * size[1]).max(low[0] * low[1]) as usize;
        let buffers = [most_visible, seen, v_image, v_residual, v_base];
        pass.linear(&RESIDUAL_COMPOSE_BACKWARD, &buffers, bytes_of(&self.params), items);
    }
}
