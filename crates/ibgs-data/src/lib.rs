//! What Image-Based Gaussian Splatting reads and writes: posed photos, Gaussians, camera paths, pictures. No GPU.
//!
//! 1. [`dataset`] loads posed photos and the initial points (COLMAP, transforms.json, and others).
//! 2. [`scene`] makes Gaussians of the points, and reads and writes their files.
//! 3. [`picture`] draws what a view shows, as pictures and EXR; [`image_io`] encodes and decodes them.
//! 4. [`camera_path`] is the way of a camera through a scene.
//!
//! [`local_space`] makes results independent of a scene's unit and position. [`progress`] reports long work; warnings and notes go
//! to the `log` crate.

pub mod adjust;
pub mod camera;
pub mod camera_change;
pub mod camera_path;
pub mod cholesky;
pub mod dataset;
pub mod files;
pub mod image_io;
pub mod local_space;
pub mod lru;
pub mod matching;
mod median;
pub mod memory;
pub mod picture;
mod ply_color;
pub mod ply_offset;
pub mod progress;
pub mod scene;
mod sentence;
pub mod similarity;
pub mod stored_zip;
pub mod words;

pub use median::median;
pub use sentence::{counted, first_of, sentence, sentence_with};
