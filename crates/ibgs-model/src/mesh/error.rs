//! Why there is no mesh, or no score of one.

use crate::files::WriteError;
use crate::gpu::Bytes;
use crate::local_space::Length;
use std::io;
use std::path::PathBuf;
use thiserror::Error;

/// Why there is no mesh, or no score of one.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum MeshError {
    /// No view has a depth that may be used.
    #[error(
        "the views show no surface {place}; train the model longer or relax bounds, largest depth and largest angle"
    )]
    NoSurface {
        /// Where it was looked for.
        place: &'static str,
    },
    /// An option has no usable value.
    #[error("{option} is {value}, which is not {wanted}; choose another value")]
    Option {
        /// The option in words.
        option: &'static str,
        /// What it is.
        value: String,
        /// What it should be.
        wanted: &'static str,
    },
    /// The voxels do not fit into the memory allowed.
    #[error(
        "voxels of {} need more memory than the limit of {}", Length(*voxel), Bytes(*limit)
    )]
    Voxels {
        /// Voxel size in scene units.
        voxel: f64,
        /// Bytes allowed.
        limit: u64,
        /// A voxel size that fits.
        enough: f64,
    },
    /// The depth maps, and the photos for a texture, do not fit into the memory allowed.
    #[error("the {what} of {views} views need {}, over the limit of {}", Bytes(*needed), Bytes(*limit))]
    DepthMaps {
        /// What does not fit.
        what: &'static str,
        /// Number of views.
        views: usize,
        /// Bytes needed.
        needed: u64,
        /// Bytes allowed.
        limit: u64,
    },
    /// The ending of the file's name is that of no format.
    #[error("{} must end in `.ply`, `.obj` or `.glb`", path.display())]
    Format {
        /// The file.
        path: PathBuf,
    },
    /// The format has no texture.
    #[error("{} cannot have a texture; choose a name that ends in `.glb` or `.obj`", path.display())]
    Untextured {
        /// The file.
        path: PathBuf,
    },
    /// The material or texture of an OBJ would replace a file of something else.
    #[error("{} is there already, and is not of a mesh that was written here; choose another name for the mesh", path.display())]
    InTheWay {
        /// That file.
        path: PathBuf,
    },
    /// The mesh does not fit into the format.
    #[error("the mesh of {} triangles is too large for {}, which ends at 4 GiB; write a `.ply` or choose larger voxels", triangles, path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Number of triangles.
        triangles: usize,
    },
    /// Writing failed.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// The operating system refused to read a file.
    #[error("cannot read {}: {source}; check the path", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// A file does not hold what it should.
    #[error("{} is no {kind}: {reason}", path.display())]
    Bad {
        /// The file.
        path: PathBuf,
        /// What it should be.
        kind: &'static str,
        /// What is wrong, with field or line.
        reason: String,
    },
    /// One of the two surfaces has no points where they are compared.
    #[error("{which} has no point {place}; check transform, crop and scale")]
    NoPoints {
        /// Mesh or truth.
        which: &'static str,
        /// Where its points are missing.
        place: &'static str,
    },
}
