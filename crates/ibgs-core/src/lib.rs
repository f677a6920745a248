//! Image-Based Gaussian Splatting: from posed photos to new views.
//!
//! The pipeline, module by module:
//! 1. [`dataset`] loads posed photos and the initial points (COLMAP, transforms.json, or the built-in demo scene).
//! 2. [`scene`] turns the points into Gaussians, on the host and on the device, and reads and writes PLY.
//! 3. [`raster`] projects, sorts and blends them, forward and backward, as a burn autodiff operation.
//! 4. [`fuse`] chooses the source views, keeps their photos and depth maps, and warps them into the view.
//! 5. [`residual`] makes the warped colours a residual with a small network, and adds it to the base image.
//! 6. [`loss`] compares base and final image with the photo, and the surface with itself and with the sources.
//! 7. [`train`] runs the loop: schedule, optimiser, densification, output folder.
//! 8. [`render`] is the one path from a model to images, which training, [`eval`] and [`mod@bench`] use too.
//! 9. [`memory`] reckons what a training will take.
//! 10. [`bundle`] keeps a model in one file; [`picture`] writes what a view shows as pictures and EXR, [`present`] puts it on
//!     the screen, [`video`] makes films, [`inspect`] tells why one of its pixels looks as it does.
//! 11. [`mesh`] fuses the depths of all views into a triangle mesh and compares that with a true surface.
//!
//! [`local_space`] makes any unit and any place of a scene alike. [`gpu`] is the ground: the one device that burn and our WGSL kernels share. [`terminal`] tells the user.

pub mod bundle;
pub mod camera;
pub mod camera_path;
pub mod config;
pub mod dataset;
pub mod eval;
pub mod exposure;
pub mod files;
pub mod gpu;
pub mod image_io;
pub mod inspect;
pub mod local_space;
pub mod mesh;
pub mod model;
pub mod output;
pub mod picture;
mod ply_offset;
pub mod present;
pub mod progress;
pub mod raster;
pub mod render;
pub mod residual;
pub mod scene;
pub mod sources;
pub mod stored_zip;
pub mod video;
