//! Files of Gaussians that other programs read and write: one module a format, with its reader and its writer.
//!
//! Gaussians in memory have the axes of 3DGS: x to the right, y down, z forward ("RDF"). Each module says which axes its
//! files have (`axes` changes the signs), how colours, opacities, scales and quaternions are kept, and in how many bits.

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

pub(super) use finite::{Dropped, is_rotation, settle};

use super::{Gaussians, MAX_SH_DEGREE, PlyFlavor, SceneError, ply};
use crate::files;
use crate::local_space::LocalSpace;
use glam::DVec3;
use std::fmt;
use std::fs::File;
use std::io::{self, BufRead, Read, Seek, Write};
use std::path::Path;

/// A format of files that hold Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// PLY of 32-bit floats, as 3DGS writes it.
    Ply,
    /// PLY in chunks of 256 Gaussians with packed values, as SuperSplat writes it.
    CompressedPly,
    /// Niantic's SPZ: written in version 3, read in versions 2 and 3.
    Spz,
    /// 32 bytes a Gaussian, as antimatter15's viewer reads it.
    Splat,
    /// Binary glTF with the extension `KHR_gaussian_splatting`.
    Gltf,
    /// PlayCanvas' SOG, version 2: lossless WebP pictures in a ZIP archive.
    Sog,
}

impl Format {
    /// All formats. `.compressed.ply` comes before `.ply`, which it ends in.
    pub const ALL: [Self; 6] = [Self::CompressedPly, Self::Ply, Self::Spz, Self::Splat, Self::Gltf, Self::Sog];

    /// How names of such files end.
    pub fn ending(self) -> &'static str {
        match self {
            Self::Ply => ".ply",
            Self::CompressedPly => ".compressed.ply",
            Self::Spz => ".spz",
            Self::Splat => ".splat",
            Self::Gltf => ".glb",
            Self::Sog => ".sog",
        }
    }

    /// The format that the ending of a name asks for.
    pub fn of_name(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_str()?.to_ascii_lowercase();
        Self::ALL.into_iter().find(|format| name.ends_with(format.ending()))
    }

    /// The format of a file by its first four bytes; [`Format::Ply`] stands for both kinds of PLY. `.splat` files have no mark.
    pub fn of_contents(start: &[u8]) -> Option<Self> {
        match start {
            [b'p', b'l', b'y', ..] => Some(Self::Ply),
            [0x1f, 0x8b, ..] | b"NGSP" => Some(Self::Spz),
            b"glTF" => Some(Self::Gltf),
            b"PK\x03\x04" => Some(Self::Sog),
            _ => None,
        }
    }

    /// Highest degree of the spherical harmonics that such files keep.
    pub fn max_sh_degree(self) -> u32 {
        if self == Self::Splat { 0 } else { MAX_SH_DEGREE }
    }

    /// What of a file says where its coordinates lie in the scene ([`Gaussians::file_offset`]).
    fn place_of_offset(self) -> Option<&'static str> {
        match self {
            Self::Ply | Self::CompressedPly => Some("the line `comment offset` of its header"),
            Self::Gltf => Some("the translation of its node"),
            Self::Spz | Self::Splat | Self::Sog => None,
        }
    }

    /// What a file of this format leaves out of a model or splits off, beside precision and planes.
    pub fn losses(self, gaussians: &Gaussians) -> Vec<Loss> {
        let (degree, kept) = (gaussians.sh_degree, self.max_sh_degree());
        let harmonics = (degree > kept).then_some(Loss::Harmonics { degree, kept });
        let offset = gaussians.file_offset().map(|offset| match self.place_of_offset() {
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

/// Writes a file's bytes.
type Writer<'a> = Box<dyn Fn(&mut dyn Write) -> io::Result<()> + 'a>;

/// Writes Gaussians in a format, in scene units, in one atomic step. [`Format::Ply`] has all fields ([`PlyFlavor::Full`]).
///
/// # Errors
/// Those of [`Gaussians::validate`], [`SceneError::CannotHold`] where the format has no place for the model (nothing is
/// written then), and [`SceneError::Write`].
pub fn write_gaussians(path: &Path, gaussians: &Gaussians, format: Format) -> Result<(), SceneError> {
    if format == Format::Ply {
        return ply::write_ply(path, gaussians, PlyFlavor::Full);
    }
    gaussians.validate()?;
    let refused = |reason| SceneError::CannotHold { path: path.to_owned(), reason };
    if gaussians.is_empty() {
        return Err(refused("the model has no Gaussians".to_owned()));
    }
    let place = LocalSpace::at(gaussians.file_offset().unwrap_or_default());
    let gaussians = gaussians.in_space(place);
    let write: Writer = match format {
        Format::Ply | Format::CompressedPly => Box::new(|out| compressed_ply::write(&gaussians, out)),
        Format::Splat => Box::new(|out| splat::write(&gaussians, out)),
        Format::Spz => {
            let turned = axes::turned(&gaussians, axes::RUB);
            let bits = spz::fractional_bits(&turned).map_err(refused)?;
            Box::new(move |out| spz::write(&turned, bits, out))
        }
        Format::Gltf => {
            let turned = axes::turned(&gaussians, axes::LUF);
            gltf::check(&turned).map_err(refused)?;
            Box::new(move |out| gltf::write(&turned, out))
        }
        Format::Sog => {
            let bytes = sog::encode(&gaussians, order::morton(&gaussians)).map_err(refused)?;
            Box::new(move |out| out.write_all(&bytes))
        }
    };
    files::write_atomically(path, |out| write(out))?;
    Ok(())
}

/// Reads Gaussians from a file of any [`Format`]. Its contents say which it is, not its name; only `.splat` files, which
/// begin with no mark, are known by their ending. Gaussians with values that are not finite, or with a quaternion of
/// zeros, are left out, with a warning in the log. They come in scene units; what has no plane gets the normal (0, 0, 1) and the offset 0.
///
/// # Errors
/// A [`SceneError`] that names the file and what is wrong in it.
pub fn read_gaussians(path: &Path) -> Result<Gaussians, SceneError> {
    let (mut file, length) = ply::open(path)?;
    read_gaussians_from(&mut file, length, path)
}

/// [`read_gaussians`] from anything seekable that is `length` bytes long; `path` is for messages, and for `.splat`.
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
    let by_name = Format::of_name(path).filter(|&format| format == Format::Splat);
    let Some(format) = Format::of_contents(&start).or(by_name) else {
        // A file with the name of a PLY that is none gets a better message there.
        return match Format::of_name(path) {
            Some(Format::Ply | Format::CompressedPly) => ply::read_ply_from(reader, length, path),
            _ => Err(SceneError::UnknownFormat { path: path.to_owned() }),
        };
    };
    if format == Format::Ply {
        return ply::read_ply_from(reader, length, path);
    }
    let mut bytes = Vec::new();
    reader.take(length).read_to_end(&mut bytes).map_err(io_error)?;
    let gaussians = match format {
        Format::Ply | Format::CompressedPly => unreachable!("both are read above"),
        Format::Spz => spz::read(&bytes),
        Format::Splat => splat::read(&bytes),
        Format::Gltf => gltf_read::read(&bytes, path),
        Format::Sog => sog_read::read(&bytes),
    };
    let bad = |reason| SceneError::BadFile { path: path.to_owned(), format: format.ending(), reason };
    without_planes(gaussians.map_err(bad)?, path)
}

/// What was read from a format without planes: Gaussians that say so, and only those whose values are finite.
///
/// # Errors
/// As [`finite::only`].
fn without_planes(mut gaussians: Gaussians, path: &Path) -> Result<Gaussians, SceneError> {
    gaussians.remove_planes();
    finite::only(gaussians, path)
}
