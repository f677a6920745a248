//! Files of Gaussians that other programs read and write: one module a format, with its reader and its writer.
//!
//! Gaussians in memory have the axes of 3DGS: x to the right, y down, z forward ("RDF"). Each module states what
//! is known of its format as a `Row`, and says how colours, opacities, scales and quaternions are kept, and in how many bits.

mod axes;
pub(super) mod compressed_ply;
mod finite;
mod gltf;
mod gltf_buffers;
mod gltf_colors;
mod gltf_nodes;
mod gltf_read;
mod ksplat;
mod order;
pub mod packed;
mod palette;
mod quantise;
mod sog;
mod sog_meta;
mod sog_parts;
mod sog_read;
mod sog_streamed;
mod splat;
mod spz;
mod spz_read;
mod strays;
#[cfg(test)]
mod tests;
mod usda;
mod usda_read;
mod usda_text;

pub(super) use {finite::Dropped, finite::is_rotation, finite::make_finite, gltf_nodes::turn_each};
#[cfg(test)]
pub(super) use {gltf_nodes::basis, tests::random};
pub use {sog::write_sog_folder, spz::SpzVersion, spz::write_spz};

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
    /// Niantic's SPZ: written in version 4 ([`write_spz`] writes version 3 too), read in versions 2 to 4.
    Spz => spz::ROW,
    /// 32 bytes a Gaussian, as antimatter15's viewer reads it.
    Splat => splat::ROW,
    /// Binary glTF with the extension `KHR_gaussian_splatting`.
    Gltf => gltf::ROW,
    /// glTF as text with the same extension; read only.
    GltfText => gltf::TEXT,
    /// PlayCanvas' SOG: lossless WebP pictures in a ZIP archive; written in version 2, read in versions 1 and 2.
    Sog => sog::ROW,
    /// SOG as a `meta.json` with its pictures beside it, or the `lod-meta.json` of several; read only.
    SogFolder => sog::FOLDER,
    /// The format of GaussianSplats3D; read only.
    Ksplat => ksplat::ROW,
    /// OpenUSD's `ParticleField3DGaussianSplat` in a text layer.
    Usda => usda::ROW,
}

/// What writes a file's bytes, or why a file cannot hold the model.
type Writer<'a> = Result<Box<dyn Fn(&mut dyn Write) -> io::Result<()> + 'a>, String>;

/// What was read, or what is wrong in a file.
type Found = Result<Gaussians, String>;

/// Reads the bytes of a whole file; the path is that of the file.
type ReadWhole = fn(&[u8], &Path) -> Found;

/// The steps in which files keep values: 0 where they keep floats, or numbers of codebooks or between bounds, whose steps
/// follow the values.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Steps {
    /// Of a component of the unit quaternion.
    pub rotation: f64,
    /// Of the coefficients of the spherical harmonics of each degree.
    pub sh: [f64; MAX_SH_DEGREE as usize + 1],
}

/// Who writes files of a format.
#[derive(Clone, Copy)]
enum Writing {
    /// [`ply::write_ply`].
    Ply,
    /// What makes ready for writing, with the axes of the files.
    By(fn(&Gaussians) -> Writer<'_>),
    /// Nobody: it is read only.
    Never,
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
    /// The step of positions where all of them share one range.
    position_step: Option<strays::Step>,
    /// Whether files say that Gaussians were trained with antialiasing ([`Gaussians::antialiased`]).
    keeps_antialiased: bool,
    /// What of a file says where its coordinates lie in the scene ([`Gaussians::file_offset`]).
    place_of_offset: Option<&'static str>,
    writing: Writing,
    /// Reads a whole file, whose path is for messages, with the axes of the files; none: [`ply::read_ply_from`], which tells
    /// both kinds of PLY apart.
    read: Option<ReadWhole>,
}

const PLY: Row = Row {
    name: "PLY of 3DGS",
    ending: ".ply",
    marks: &[b"ply"],
    axes: axes::RDF,
    max_sh_degree: MAX_SH_DEGREE,
    steps: Steps { rotation: 0.0, sh: [0.0; 4] },
    position_step: None,
    keeps_antialiased: true,
    place_of_offset: Some("the line `comment offset` of its header"),
    writing: Writing::Ply,
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
        listed(Self::ALL.into_iter())
    }

    /// The endings of the formats that are written, for sentences.
    pub fn written_endings() -> String {
        listed(Self::written())
    }

    /// The formats that are written; the others are read only.
    pub fn written() -> impl Iterator<Item = Self> {
        Self::ALL.into_iter().filter(|format| !matches!(format.row().writing, Writing::Never))
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
        let strays = self.row().position_step.and_then(|step| strays::find(gaussians, step));
        let antialiased = (gaussians.antialiased && !self.row().keeps_antialiased).then_some(Loss::Antialiased);
        harmonics.into_iter().chain(offset).chain(strays).chain(antialiased).collect()
    }
}

fn listed(formats: impl Iterator<Item = Format>) -> String {
    formats.map(|format| format!("`{}`", format.ending())).collect::<Vec<_>>().join(", ")
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
    /// That the Gaussians were trained with antialiasing.
    Antialiased,
    /// Precision, as some Gaussians lie far away from the others.
    Strays {
        /// How many.
        count: usize,
        /// The largest coordinate of any.
        reach: f64,
        /// The largest coordinate of 99.9 % of the Gaussians.
        usual: f64,
        /// The steps to which the file rounds positions of these.
        coarse: f64,
        /// The steps without the far ones.
        fine: f64,
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
            Self::Antialiased => {
                write!(f, "the format has no place for the tag that they were trained with antialiasing")
            }
            Self::Strays { count, reach, usual, coarse, fine } => write!(
                f,
                "{count} Gaussian{} up to {reach} from the origin, 99.9 % within {usual:.3}; for them the format rounds all \
                 positions to steps of {coarse:.6}, not {fine:.6}; remove them before",
                if *count == 1 { " lies" } else { "s lie" }
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
    match format.row().writing {
        Writing::Ply => ply::write_ply(path, gaussians, PlyFlavor::Full),
        Writing::By(writer) => write_with(path, gaussians, format.row().axes, writer),
        Writing::Never => {
            let reason =
                format!("files in `{}` are read only; choose one of {}", format.ending(), Format::written_endings());
            Err(SceneError::CannotHold { path: path.to_owned(), reason })
        }
    }
}

/// Writes Gaussians with the axes of a file in one atomic step.
///
/// # Errors
/// As [`write_gaussians`].
fn write_with(
    path: &Path,
    gaussians: &Gaussians,
    axes: [f32; 3],
    writer: impl FnOnce(&Gaussians) -> Writer<'_>,
) -> Result<(), SceneError> {
    gaussians.validate()?;
    let refused = |reason| SceneError::CannotHold { path: path.to_owned(), reason };
    if gaussians.is_empty() {
        return Err(refused("the model has no Gaussians".to_owned()));
    }
    let place = LocalSpace::at(gaussians.file_offset().unwrap_or_default());
    let gaussians = axes::turned(gaussians.in_space(place), axes);
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
    let gaussians = match format.row().read {
        Some(read) => read_whole(reader, length, path, (format, read)),
        None => ply::read_ply_from(reader, length, path),
    }?;
    if gaussians.antialiased {
        log::warn!(
            "{}: its Gaussians were trained with antialiasing, and are shown without: small ones look too large",
            path.display()
        );
    }
    Ok(gaussians)
}

fn read_whole<R: BufRead>(
    reader: &mut R,
    length: u64,
    path: &Path,
    (format, read): (Format, ReadWhole),
) -> Result<Gaussians, SceneError> {
    let mut bytes = Vec::new();
    reader.take(length).read_to_end(&mut bytes).map_err(|source| ply::read_error(path, source))?;
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
