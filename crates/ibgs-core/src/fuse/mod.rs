//! What the photos of neighbouring training views tell about a target view (method.md sections 4, 5 and 8).

pub mod depth_cache;
pub mod memory;
pub mod source_store;
pub mod sources;
mod warp;

pub use warp::{MAX_SOURCES, Reach, Seen, SourceView, WarpOptions, Warper};
