//! Losses (method.md section 7).

mod image;
mod normal;
mod photometric;

pub use image::{ImageLoss, ImageStats, LossScratch};
pub use normal::{NormalLoss, SurfaceBuffers};
pub use photometric::PhotometricLoss;
