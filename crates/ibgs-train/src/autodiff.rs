//! The kernels of [`ibgs_core`] as operations of burn's autodiff.

mod exposure;
mod node;
mod raster;
mod residual;
mod slice;
mod warp;

pub use exposure::{exposed, exposed_warped};
pub use node::unary;
pub use raster::{Leaves, SplatGradients, rasterized};
pub use residual::residual;
pub use slice::slice;
pub use warp::warped;
