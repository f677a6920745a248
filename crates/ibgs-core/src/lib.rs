//! Image-Based Gaussian Splatting: opens and renders models, and everything around that needs no training.
//!
//! ```text
//!  photos, poses ── dataset ──► scene ──────► Gaussians ─┐
//!                     │                                  │  on the device: Splats
//!                     │                                  ▼
//!                     │    camera ────────────────► raster ──► base image, normals, median depth, intersections
//!                     ▼                                  │                 │
//!            source photos, depth maps ──► sources ◄─────┘                 │
//!                                            │ warped colours              │
//!                                            ▼                             ▼
//!                                         exposure ──► residual ──► final image ──► picture, present, eval
//! ```
//!
//! 1. [`dataset`] loads posed photos and the initial points (COLMAP, transforms.json, and others).
//! 2. [`scene`] makes Gaussians of the points, on the host and on the device, and reads and writes PLY.
//! 3. [`raster`] projects, sorts and blends them: the forward and the backward pass.
//! 4. [`sources`] chooses the source views, keeps their photos and depth maps, and warps them into the target view.
//! 5. [`exposure`] brings colours into the exposure of a photo.
//! 6. [`residual`] makes a residual of the warped colours with a small network, adds it to the base image, and mixes the
//!    sources' mean colour into rendered views.
//! 7. [`render`] is the one path from a model to images; [`model`] opens models, [`bundle`] keeps one in a single file,
//!    [`output`] is the model folder, [`config`] the options of a training.
//! 8. [`edit`] selects and removes Gaussians of a finished model.
//! 9. [`eval`] measures, [`picture`] writes what a view shows as pictures and EXR, [`present`] puts it on the screen, [`video`]
//!    makes films, [`inspect`] explains a pixel, [`mesh`] fuses the depths of all views into a triangle mesh.
//!
//! [`local_space`] makes results independent of a scene's unit and position. [`gpu`] is the base layer: the device, its
//! memory and the only place that dispatches. [`progress`] reports long work; warnings and notes go to the `log` crate.
//! Training is in `ibgs-train`.
//!
//! This crate is the front of three: `ibgs-data` (no GPU), `ibgs-render` and `ibgs-model`.
//!
//! A model is rendered in a line:
//!
//! ```no_run
//! use ibgs_core::gpu::{AdapterChoice, Gpu, Use};
//! use ibgs_core::model::{Model, ModelOptions};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let gpu = Gpu::open(&AdapterChoice::Best, Use::Rendering)?;
//! let mut model = Model::open("output/garden".as_ref(), &ModelOptions::default())?;
//! let renderer = model.renderer(&gpu)?;
//! let frame = renderer.render(&model.cameras[0].camera)?;
//! println!("{} pixels", frame.base()?.rgb.len() / 3);
//! # Ok(())
//! # }
//! ```

pub use ibgs_data::{
    adjust, camera, camera_change, camera_path, counted, dataset, files, first_of, image_io, local_space, matching,
    median, picture, progress, sentence, sentence_with, similarity, stored_zip, words,
};
#[cfg(not(target_arch = "wasm32"))]
pub use ibgs_model::mesh;
pub use ibgs_model::{blocks, bundle, config, edit, ensemble, eval, model, output, video};
pub use ibgs_render::{exposure, gpu, inspect, levels, present, raster, render, residual, scene, sources};
