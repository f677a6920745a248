//! What the photos of neighbouring training views tell about a target view (method.md sections 4, 5 and 8).

mod warp;

pub use warp::{Seen, SourceView, WarpOptions, Warper};
pub mod depth_cache;
pub mod memory;
pub mod source_store;
pub mod sources;
