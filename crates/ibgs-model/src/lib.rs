//! Models of Image-Based Gaussian Splatting: their options, their files, and what is done with them besides rendering.
//!
//! 1. [`config`] has the options of a training, which a model keeps.
//! 2. [`model`] opens models, [`bundle`] keeps one in a single file, [`output`] is the model folder.
//! 3. [`eval`] measures, [`video`] makes films, [`mesh`] fuses the depths of all views into a triangle mesh.
//! 4. [`edit`] selects and removes Gaussians of a finished model, [`blocks`] joins those of its parts, [`ensemble`] has the
//!    further members of one.

pub mod blocks;
pub mod bundle;
pub mod config;
pub mod edit;
pub mod ensemble;
pub mod eval;
#[cfg(not(target_arch = "wasm32"))]
pub mod mesh;
pub mod model;
pub mod output;
mod score;
pub mod video;

// What the modules here build on, by its short name.
use ibgs_data::{
    camera, camera_change, cholesky, counted, dataset, files, image_io, local_space, picture, progress, similarity,
    stored_zip,
};
use ibgs_render::{exposure, gpu, levels, raster, render, residual, scene, sources};
