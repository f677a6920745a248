//! Losses (method.md section 7).

mod image;

pub use image::{ImageLoss, ImageStats, Target};
