//! The Gaussians: their parameters, their start from a point cloud, and their files.

pub mod error;
pub mod formats;
pub mod gaussians;
pub mod init;
mod moved;
mod per_gaussian;
pub mod ply;
mod ply_rows;
mod tags;

pub use error::SceneError;
pub use formats::packed;
pub use formats::{
    Format, Loss, SpzVersion, Steps, is_gaussians, read_gaussians, read_gaussians_from, write_gaussians,
    write_sog_folder, write_spz,
};
pub use gaussians::{Gaussians, MAX_SH_DEGREE, SH_C0};
pub use init::from_points;
pub use per_gaussian::PerGaussian;
pub use ply::{PlyFlavor, read_ply, read_ply_from, write_ply, write_ply_to, write_points_ply};
