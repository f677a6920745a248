//! The passes of Image-Based Gaussian Splatting on the GPU, and the renderer made of them.
//!
//! 1. [`scene`] has Gaussians on the device.
//! 2. [`raster`] projects, sorts and blends them: the forward and the backward pass.
//! 3. [`sources`] chooses the source views, keeps their photos and depth maps, and warps them into the target view.
//! 4. [`exposure`] brings colours into the exposure of a photo.
//! 5. [`residual`] makes a residual of the warped colours with a small network, adds it to the base image, and mixes the
//!    sources' mean colour into rendered views.
//! 6. [`render`] is the one path from a model to images; [`levels`] renders models that are larger than the device's memory.
//! 7. [`present`] puts a view on the screen, [`inspect`] explains a pixel.
//!
//! [`gpu`] is the base layer: the device, its memory and the only place that dispatches.

pub mod ensemble;
pub mod exposure;
pub mod gpu;
pub mod inspect;
pub mod levels;
pub mod present;
pub mod raster;
pub mod render;
pub mod residual;
pub mod scene;
pub mod sources;

// What the modules here build on, by its short name.
use ibgs_data::{camera, dataset, files, local_space, lru, picture, progress};
