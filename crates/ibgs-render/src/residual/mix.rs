//! The sources' share in a rendered view's final colour.
//!
//! Gaussians and network fit their training photos 1 to 4 dB better than other views. So on a training photo the sources
//! tell little that the base does not know, and the network learns to pass less of them than other views need. A view that is
//! rendered therefore moves towards its sources' mean colour:
//!
//! ```text
//! a_m = exp(-e_m^2 / 2 - |d - d_m| / ANGLE)         e_m the error of the depth in units of what agrees, d viewing directions
//! C'  = C + share / (DOUBT + sum a_m) sum a_m (c_m - C)
//! ```
//!
//! In training the share is 0: the network would learn to take it back. A departure from the published method (method.md section 6).

use crate::gpu::{Buffer, Pass};
use ibgs_shaders::bindings::ResidualMixBindings;
use ibgs_shaders::types::MixParams;

/// Moves final colours towards the mean colour of the visible sources.
#[derive(Clone, Copy, Debug)]
pub struct SourceMix {
    params: MixParams,
}

impl SourceMix {
    /// Distance of the unit viewing directions at which a source counts 1/e, about an angle in radians.
    pub const ANGLE: f32 = 0.15;
    /// What stands against the sources' weights: a single one from the view's own direction has 0.95 of the share.
    pub const DOUBT: f32 = 0.05;

    /// The mix of an image of `pixels` pixels that see up to `visible` sources; those from the view's own direction have about
    /// `share` of the colour, 0 to 1.
    pub fn new(pixels: u32, visible: u32, share: f32) -> Self {
        Self { params: MixParams { pixels, visible, share, angle: Self::ANGLE, doubt: Self::DOUBT } }
    }

    /// Records the change of `image`, `[P, 3]`. `warped` is `[V, P, 4]`, in the exposure of the image, `seen` `[P]` u32 as in
    /// [`Seen::visible`](crate::sources::Seen::visible).
    pub fn record(&self, pass: &mut Pass<'_>, warped: &Buffer<[f32; 4]>, seen: &Buffer<u32>, image: &Buffer<f32>) {
        if self.params.share > 0.0 {
            let bindings = ResidualMixBindings { warped, seen, image };
            pass.linear(&bindings, &self.params, self.params.pixels as usize);
        }
    }
}
