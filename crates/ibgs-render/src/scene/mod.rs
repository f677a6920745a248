//! The Gaussians, on the host and on the device.

mod harmonics;
mod splats;

pub use harmonics::Harmonics;
pub use ibgs_data::scene::*;
pub use splats::Splats;
