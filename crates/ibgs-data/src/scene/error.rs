//! Errors of the scene module: what, where, what to do.

use super::Format;
use crate::files::WriteError;
use std::path::PathBuf;
use thiserror::Error;

/// Why Gaussians could not be made, read or written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SceneError {
    /// Levels of detail of nothing.
    #[error("the model has no Gaussian, and so no levels of detail")]
    NoGaussians,
    /// The operating system refused to read the file.
    #[error("cannot read {}: {source}; check that the path names a file of Gaussians", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The header of a PLY file is wrong.
    #[error("{} is not a usable PLY file: {reason}", path.display())]
    BadPly {
        /// The file.
        path: PathBuf,
        /// What is wrong and, where it helps, what to do.
        reason: String,
    },
    /// The vertices have two scales each, as 2D Gaussian splatting writes them.
    #[error("{} has two scales for each Gaussian: flat ones of 2D Gaussian splatting, which are not read", path.display())]
    TwoScales {
        /// The file.
        path: PathBuf,
    },
    /// The file begins like none that is read.
    #[error("{} is no file of Gaussians that is read: {}", path.display(), Format::endings())]
    UnknownFormat {
        /// The file.
        path: PathBuf,
    },
    /// A file of another format than PLY is wrong.
    #[error("{} is not a usable `{format}` file: {reason}", path.display())]
    BadFile {
        /// The file.
        path: PathBuf,
        /// Ending of the format's names.
        format: &'static str,
        /// What is wrong.
        reason: String,
    },
    /// A format has no place for a model.
    #[error("{} cannot be written: {reason}", path.display())]
    CannotHold {
        /// The file that was to be written.
        path: PathBuf,
        /// What does not fit.
        reason: String,
    },
    /// A field that every Gaussian needs is not in the file.
    #[error(
        "{} has no field `{field}` in its vertex element; a model of Gaussians needs it, is this a plain point cloud?",
        path.display()
    )]
    MissingField {
        /// The file.
        path: PathBuf,
        /// The PLY property.
        field: String,
    },
    /// The file ends before its header says it does.
    #[error(
        "{} is truncated: its header promises {promised} Gaussians, the data holds {found}; copy or export it again",
        path.display()
    )]
    Truncated {
        /// The file.
        path: PathBuf,
        /// Rows in the header.
        promised: u64,
        /// Whole rows in the data.
        found: u64,
    },
    /// A value is NaN or infinite; in a file, no Gaussian is without.
    #[error("{place}: `{field}` of Gaussian {index} (counted from 0) is {value}, which is not a finite number")]
    NotFinite {
        /// File, or the model in memory.
        place: String,
        /// PLY property or field of [`Gaussians`](super::Gaussians).
        field: String,
        /// Row.
        index: usize,
        /// The value.
        value: f32,
    },
    /// All Gaussians of a file have the quaternion 0.
    #[error(
        "the rotations (`rot_0` to `rot_3`) of all {count} Gaussians of {} are zeros, so they have no shape; export them \
         again with their rotations",
        path.display()
    )]
    ZeroRotations {
        /// The file.
        path: PathBuf,
        /// Its Gaussians.
        count: usize,
    },
    /// Fields of a model in memory do not fit each other.
    #[error("the model's field `{field}` holds {found} values where {expected} are needed")]
    Shape {
        /// Field of [`Gaussians`](super::Gaussians).
        field: &'static str,
        /// Values that the number of Gaussians asks for.
        expected: usize,
        /// Values there.
        found: usize,
    },
    /// A degree of the spherical harmonics that nothing here can evaluate.
    #[error("spherical harmonics of degree {degree} are not supported; choose 0, 1, 2 or 3")]
    ShDegree {
        /// The degree asked for.
        degree: u32,
    },
    /// A point of the initial cloud cannot become a Gaussian.
    #[error(
        "initial point {index} (counted from 0) has the position {position:?}, which is not finite in 32 bits; remove it from the point cloud"
    )]
    BadPoint {
        /// Index into the points.
        index: usize,
        /// Its position.
        position: [f64; 3],
    },
    /// The initial opacity is no opacity.
    #[error("initial opacity {opacity} is not between 0 and 1 (both excluded)")]
    BadOpacity {
        /// The value asked for.
        opacity: f64,
    },
    /// The device did not give the model back.
    #[error("the model could not be read back from the GPU: {0}")]
    Device(String),
    /// Writing failed.
    #[error(transparent)]
    Write(#[from] WriteError),
}
