pub mod compose;
pub mod features;
pub mod layers;
pub mod variant;

pub use variant::{Aggregation, Factor, Inputs, Output, Variant};
