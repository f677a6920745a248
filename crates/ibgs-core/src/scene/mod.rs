//! The Gaussians: their parameters, their start from a point cloud, and their files.

pub mod error;
pub mod formats;
pub mod gaussians;
mod harmonics;
pub mod init;
mod per_gaussian;
pub mod ply;
mod ply_rows;
mod splats;

pub use error::SceneError;
pub(crate) use formats::packed;
pub use formats::{Format, Loss, is_gaussians, read_gaussians, read_gaussians_from, write_gaussians};
pub use gaussians::{Gaussians, MAX_SH_DEGREE, SH_C0};
pub use harmonics::Harmonics;
pub use init::from_points;
pub use per_gaussian::PerGaussian;
pub(crate) use ply::write_ply_to;
pub use ply::{PlyFlavor, read_ply, read_ply_from, write_ply, write_points_ply};
pub use splats::{Splats, values_of};
