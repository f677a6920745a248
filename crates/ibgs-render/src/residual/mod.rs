//! The residual network (method.md section 6): [`features`] and per-view MLP, then the U-Net, then [`compose`]; views that are
//! rendered, not trained on, then [`mix`] in the sources' mean colour.

pub mod compose;
pub mod features;
pub mod mix;
pub mod network;
mod operation;
pub mod pth;
pub mod state_dict;
pub mod unet;
pub mod variant;
pub mod weights;

pub use ibgs_shaders::layers;
pub use network::ResidualNetwork;
pub use operation::{Residual, ResidualGradients, ResidualInputs, ResidualPass, ResidualTask};
pub use unet::{Arithmetic, UNet};
pub use variant::{Aggregation, Factor, Output, Precision, Variant};
pub use weights::NetworkError;
