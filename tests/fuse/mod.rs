//! Sources: their choice, their photos and their depth maps.

mod sources;
