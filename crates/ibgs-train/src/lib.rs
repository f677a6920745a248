//! Training of Image-Based Gaussian Splatting: what [`ibgs_core`] renders, made from photos.
//!
//! burn is known here alone. It holds the graph of an iteration; every node of it is one or several of the core's kernels:
//! 1. [`parameters`] are the Gaussians and the network as burn tensors, whose memory the kernels share ([`tensor`]).
//! 2. [`autodiff`] makes rasterizer, warping, exposure and residual network nodes of the graph.
//! 3. [`loss`] compares base and final image with the photo, and the surface with itself and with the sources.
//! 4. [`Trainer`] runs the iteration: [`optim`], [`densify`], [`checkpoint`].
//! 5. [`Session`] runs a training from its first iteration to its last: checkpoints, saving, measuring.
//! 6. [`memory`] estimates the device memory a training needs, [`mod@bench`] measures rendering and training, [`lpips`] is the
//!    distance that needs a network.

pub mod autodiff;
mod background;
pub mod bench;
pub mod checkpoint;
pub mod densify;
mod exposing;
mod exposure_trial;
mod first_points;
pub mod loss;
pub mod lpips;
pub mod memory;
pub mod optim;
pub mod parameters;
mod readback;
mod refining;
pub mod session;
mod stages;
mod step;
mod telemetry;
pub mod tensor;
mod transients;
mod trial;

/// The version of burn whose tensors are part of this crate's interface.
pub use burn;
pub use exposure_trial::{ExposureEvidence, resolve as resolve_exposure};
pub use first_points::find_points;
pub use session::Session;
pub use step::{TrainError, Trainer};
pub use telemetry::Telemetry;
pub use transients::{MaskRules, Oddity};
