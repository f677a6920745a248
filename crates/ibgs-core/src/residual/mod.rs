//! The residual network (method.md section 6): [`features`] and per-view MLP, then the hourglass, then [`compose`].

pub mod compose;
pub mod features;
pub mod layers;
pub mod network;
pub mod variant;
pub mod weights;

pub use network::ResidualNetwork;
pub use variant::{Aggregation, Factor, Inputs, Output, Variant};
pub use weights::NetworkError;
