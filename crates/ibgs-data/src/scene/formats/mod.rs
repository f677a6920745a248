//! Files of Gaussians that other programs read and write: one module a format, with its reader and its writer.
//!
//! Gaussians in memory have the axes of 3DGS: x to the right, y down, z forward ("RDF"). Each module states what
//! is known of its format as a `Row`, and says how colours, opacities, scales and quaternions are kept, and in how many bits.

mod axes;
pub(super) mod compressed_ply;
mod finite;
mod gltf;
mod gltf_colors;
mod gltf_nodes;
mod gltf_read;
mod order;
pub mod packed;
mod palette;
mod quantise;
mod sog;
mod sog_read;
mod splat;
mod spz;
#[cfg(test)]
mod tests;

pub(super) use finite::{Dropped, is_rotation, make_finite};
#[cfg(test)]
pub(super) use gltf_nodes::basis;
pub(super) use gltf_nodes::turn_each;

use super::{Gaussians, MAX_SH_DEGREE, PlyFlavor, SceneError, ply};
use crate::files;
use crate::local_space::LocalSpace;
use glam::DVec3;
use std::fmt;
use std::fs::File;
use std::io::{self, BufRead, Read, Seek, Write};
use std::path::Path;

/// The enum of the formats and their rows, of one list.
macro_rules! formats {
    ($($(#[$doc:meta])* $format:ident => $row:expr,)*) => {
        /// A format of files that hold Gaussians.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Format { $($(#[$doc])* $format,)* }

        impl Format {
            /// All formats.
            pub const ALL: [Self; [$(Self::$format),*].len()] = [$(Self::$format),*];

            fn row(self) -> &'static Row {
                match self { $(Self::$format => &$row,)* }
            }
        }
    };
}

formats! {
    /// PLY in chunks of 256 Gaussians with packed values, as SuperSplat writes it. It comes before PLY, in whose ending its
    /// own one ends.
    CompressedPly => compressed_ply::ROW,
    /// PLY of 32-bit floats, as 3DGS writes it.
    Ply => PLY,
    /// Niantic's SPZ: written in version 3, read in versions 2 and 3.
    Spz => spz::ROW,
    /// 32 bytes a Gaussian, as antimatter15's viewer reads it.
    Splat => splat::ROW,
    /// Binary glTF with the extension `KHR_gaussian_splatting`.
    Gltf => gltf::ROW,
    /// PlayCanvas' SOG, version 2: lossless WebP pictures in a ZIP archive.
    Sog => sog::ROW,
}

/// What writes a file's bytes, or why a file cannot hold the model.
type Writer<'a> = Result<Box<dyn Fn(&mut dyn Write) -> io::Result<()> + 'a>, String>;

/// What was read, or what is wrong in a file.
type Found = Result<Gaussians, String>;

/// The steps in which files keep values: 0 where they keep floats, or numbers of codebooks or between bounds, whose steps
/// follow the values.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Steps {
    /// Of a component of the unit quaternion.
    pub rotation: f64,
    /// Of the coefficients of the spherical harmonics of each degree.
    pub sh: [f64; MAX_SH_DEGREE as usize + 1],
}

/// All that is known of a format; each module states its own.
struct Row {
    /// Its name in sentences.
    name: &'static str,
    /// How names of such files end.
    ending: &'static str,
    /// What the files begin with, in four bytes at most; nothing where a name alone says it.
    marks: &'static [&'static [u8]],
    /// Signs from the axes in memory to those of the files, one of [`axes`].
    axes: [f32; 3],
    max_sh_degree: u32,
    steps: Steps,
    /// What of a file says where its coordinates lie in the scene ([`Gaussians::file_offset`]).
    place_of_offset: Option<&'static str>,
    /// Makes ready for writing, with the axes of the files; none: [`ply::write_ply`].
    writer: Option<fn(&Gaussians) -> Writer<'_>>,
    /// Reads a whole file, whose path is for messages, with the axes of the files; none: [`ply::read_ply_from`], which tells
    /// both kinds of PLY apart.
    read: Option<fn(&[u8], &Path) -> Found>,
}

const PLY: Row = Row {
    name: "PLY of 3DGS",
    ending: ".ply",
    marks: &[b"ply"],
    axes: axes::RDF,
    max_sh_degree: MAX_SH_DEGREE,
    steps: Steps { rotation: 0.0, sh: [0.0; 4] },
    place_of_offset: Some("the line `comment offset` of its header"),
    writer: None,
    read: None,
};

impl Format {
    /// Its name in sentences.
    pub fn name(self) -> &'static str {
        self.row().name
    }

    /// How names of such files end.
    pub fn ending(self) -> &'static str {
        self.row().ending
    }

    /// The endings of all formats, for sentences.
    pub fn endings() -> String {
        Self::ALL.map(|format| format!("`{}`", format.ending())).join(", ")
    }

    /// The format that the ending of a name asks for.
    pub fn of_name(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_str()?.to_ascii_lowercase();
        Self::ALL.into_iter().find(|format| name.ends_with(format.ending()))
    }

    /// The format of a file by its first four bytes; [`Format::Ply`] stands for both kinds of PLY. Some formats have no
    /// mark.
    pub fn of_contents(start: &[u8]) -> Option<Self> {
        Self::ALL.into_iter().find(|format| format.row().marks.iter().any(|mark| start.starts_with(mark)))
    }

    /// Highest degree of the spherical harmonics that such files keep.
    pub fn max_sh_degree(self) -> u32 {
        self.row().max_sh_degree
    }

    /// The steps in which such files keep values.
    pub fn steps(self) -> Steps {
        self.row().steps
    }

    /// What a file of this format leaves out of a model or splits off, beside precision and planes.
    pub fn losses(self, gaussians: &Gaussians) -> Vec<Loss> {
        let (degree, kept) = (gaussians.sh_degree, self.max_sh_degree());
        let harmonics = (degree > kept).then_some(Loss::Harmonics { degree, kept });
        let offset = gaussians.file_offset().map(|offset| match self.row().place_of_offset {
            Some(place) => Loss::SplitOff { offset, place },
            None => Loss::Offset(offset),
        });
        harmonics.into_iter().chain(offset).collect()
    }
}

/// Whether a file looks like one of Gaussians, by its first bytes or by its name.
pub fn is_gaussians(path: &Path) -> bool {
    let mut start = Vec::new();
    let read = File::open(path).and_then(|file| file.take(4).read_to_end(&mut start));
    read.is_ok() && (Format::of_contents(&start).is_some() || Format::of_name(path).is_some())
}

/// What a format leaves out of a model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Loss {
    /// Coefficients of the spherical harmonics above the degree `kept`.
    Harmonics {
        /// The model's degree.
        degree: u32,
        /// The file's.
        kept: u32,
    },
    /// Where the coordinates lie in the scene.
    Offset(DVec3),
    /// Nothing, but the coordinates of the file are around this place.
    SplitOff {
        /// The place in the scene.
        offset: DVec3,
        /// What of the file says it.
        place: &'static str,
    },
}

impl fmt::Display for Loss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Harmonics { degree, kept } => write!(
                f,
                "the format keeps spherical harmonics of degree {kept}; the model's colours that depend on the view \
                 (degree {degree}) are left out"
            ),
            Self::Offset(DVec3 { x, y, z }) => write!(
                f,
                "the format has no place for the offset of the scene; add {x} {y} {z} to the coordinates of the file"
            ),
            Self::SplitOff { offset: DVec3 { x, y, z }, place } => write!(
                f,
                "the scene lies far from its origin, so the coordinates of the file are around {x} {y} {z}, as {place} says; \
                 a program that ignores it shows the scene at the origin"
            ),
        }
    }
}

/// Writes Gaussians in a format, in scene units, in one atomic step. [`Format::Ply`] has all fields ([`PlyFlavor::Full`]).
///
/// # Errors
/// Those of [`Gaussians::validate`], [`SceneError::CannotHold`] where the format has no place for the model (nothing is
/// written then), and [`SceneError::Write`].
pub fn write_gaussians(path: &Path, gaussians: &Gaussians, format: Format) -> Result<(), SceneError> {
    let Some(writer) = format.row().writer else {
        return ply::write_ply(path, gaussians, PlyFlavor::Full);
    };
    gaussians.validate()?;
    let refused = |reason| SceneError::CannotHold { path: path.to_owned(), reason };
    if gaussians.is_empty() {
        return Err(refused("the model has no Gaussians".to_owned()));
    }
    let place = LocalSpace::at(gaussians.file_offset().unwrap_or_default());
    let gaussians = axes::turned(gaussians.in_space(place), format.row().axes);
    let write = writer(&gaussians).map_err(refused)?;
    files::write_atomically(path, |out| write(out))?;
    Ok(())
}

/// Reads Gaussians from a file of any [`Format`]. Its contents say which it is, not its name; only formats whose files begin
/// with no mark are known by their ending. Gaussians with values that are not finite, or with a quaternion of
/// zeros, are left out, with a warning in the log. They come in scene units; what has no plane gets the normal (0, 0, 1) and the offset 0.
///
/// # Errors
/// A [`SceneError`] that names the file and what is wrong in it.
pub fn read_gaussians(path: &Path) -> Result<Gaussians, SceneError> {
    let (mut file, length) = ply::open(path)?;
    read_gaussians_from(&mut file, length, path)
}

/// [`read_gaussians`] from anything seekable that is `length` bytes long; `path` is for messages, and for formats without a mark.
///
/// # Errors
/// As [`read_gaussians`].
pub fn read_gaussians_from<R: BufRead + Seek>(
    reader: &mut R,
    length: u64,
    path: &Path,
) -> Result<Gaussians, SceneError> {
    let io_error = |source| ply::read_error(path, source);
    let mut start = Vec::new();
    reader.take(4).read_to_end(&mut start).map_err(io_error)?;
    reader.rewind().map_err(io_error)?;
    // A file with the name of a PLY that is none gets a better message from the reader of PLY files.
    let is_by_name = |row: &Row| row.read.is_none() || row.marks.is_empty();
    let by_name = || Format::of_name(path).filter(|format| is_by_name(format.row()));
    let Some(format) = Format::of_contents(&start).or_else(by_name) else {
        return Err(SceneError::UnknownFormat { path: path.to_owned() });
    };
    let Some(read) = format.row().read else { return ply::read_ply_from(reader, length, path) };
    let mut bytes = Vec::new();
    reader.take(length).read_to_end(&mut bytes).map_err(io_error)?;
    let bad = |reason| SceneError::BadFile { path: path.to_owned(), format: format.ending(), reason };
    let mut gaussians = read(&bytes, path).map_err(bad)?;
    axes::turn(&mut gaussians, format.row().axes);
    without_planes(gaussians, path)
}

/// What was read from a format without planes: Gaussians that say so, and only those whose values are finite.
///
/// # Errors
/// As [`finite::only`].
fn without_planes(mut gaussians: Gaussians, path: &Path) -> Result<Gaussians, SceneError> {
    gaussians.remove_planes();
    finite::only(gaussians, path)
}
