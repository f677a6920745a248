//! Losses (method.md section 7).

mod image;
mod normal;

pub use image::{ImageLoss, ImageStats, Target};
pub use normal::{NormalLoss, SurfaceBuffers};
