//! Image-Based Gaussian Splatting: from posed photos to new views.
//!
//! The pipeline, module by module:
//! 1. [`dataset`] loads posed photos and the initial points (COLMAP, transforms.json, or the built-in demo scene).
//! 2. [`scene`] turns the points into Gaussians, on the host and on the device, and reads and writes PLY.
//! 3. [`raster`] projects, sorts and blends them, forward and backward, as a burn autodiff operation.
//! 4. [`loss`] compares the image with the photo.
//! 5. [`train`] runs the loop: schedule, optimiser, densification, output folder.
//! 6. [`render`] and [`eval`] use the trained model.
//!
//! [`gpu`] is the ground: the one device that burn and our WGSL kernels share.

pub mod bench;
pub mod bundle;
pub mod camera;
pub mod camera_path;
pub mod dataset;
pub mod eval;
pub mod files;
pub mod fuse;
pub mod gpu;
pub mod image_io;
pub mod loss;
pub mod picture;
pub mod raster;
pub mod render;
pub mod residual;
pub mod scene;
pub mod train;
