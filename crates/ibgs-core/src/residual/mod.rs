//! The residual network (method.md section 6): features and per-view MLP, hourglass, composition.

pub mod compose;
pub mod features;
pub mod layers;
pub mod variant;

pub use variant::{Aggregation, Factor, Inputs, Output, Variant};
