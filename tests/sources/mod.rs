//! Sources: their choice, their photos and their depth maps.

mod find;
mod source_store;
