//! What the photos of neighbouring training views say about a target view (method.md sections 4, 5 and 8).

pub mod depth_cache;
pub mod find;
pub mod memory;
mod photo;
pub mod source_store;
pub mod sweep;
mod warp;

pub use photo::{DevicePhoto, Outside};
pub use warp::{MAX_SOURCES, MAX_VISIBLE, Reach, Seen, SourceView, WarpOptions, Warped, Warper};
