//! The residual network (method.md section 6): features and per-view MLP, hourglass, composition.

pub mod compose;
pub mod features;
pub mod hourglass;
pub mod layers;
mod operation;
pub mod variant;

pub use hourglass::Hourglass;
pub use operation::{Residual, ResidualTask};
pub use variant::{Aggregation, Factor, Inputs, Output, Variant};
