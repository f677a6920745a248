//! Sources: their choice, their photos and their depth maps.

mod source_store;
mod sources;
