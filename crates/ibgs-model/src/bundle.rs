//! One-file bundle `.ibgs`: everything that rendering a model from new places needs, in one ZIP archive.
//!
//! ```text
//! ibgs.json         {"format": 1, "iteration": N}
//! exposure.json     the training photos' exposures, as in the output folder; absent where they were not corrected
//! cameras.json  multi_view.json  config.toml     as in the output folder
//! point_cloud.ply   the Gaussians with planes
//! network.bin       the residual network, as its own module wrote it; absent without one
//! photos/NAME.png   the training views' photos as they were trained on: undistorted, resized, 8 bits, lossless
//! ```
//!
//! A small bundle ([`Packing::Small`], format 2) has the Gaussians as `gaussians.sog` and `planes.bin` in place of
//! `point_cloud.ply`, with the scene's offset in `ibgs.json`, and opaque photos as `photos/NAME.jpg`.
//!
//! A bundle with levels of detail ([`Packing::Levels`], format 3) has `levels.json` and `levels.bin` in place of
//! `point_cloud.ply`: the tree of its chunks and their numbers, which stay in the file until they are needed.
//!
//! The order lets a browser show the base image early: with the constant colours as soon as the SOG file has come to its
//! spherical harmonics, see [`Bundle::read_start`].
//!
//! Nothing is compressed a second time: photos are compressed already, and numbers barely shrink. So no part can be larger
//! than the file. The archive's own checksums show damage.

use crate::config::TrainConfig;
use crate::dataset::{DatasetError, HostPhoto, Photo, Resampler, resample};
use crate::exposure::{self, Exposure};
use crate::files::{WriteError, write_seekable_atomically};
use crate::image_io;
use crate::levels::{self, Levels, Tree};
use crate::local_space::LocalSpace;
use crate::model;
use crate::output::cameras::{self, CameraRecord, Split};
use crate::output::multi_view::{self, ViewSources};
use crate::scene::{Gaussians, PlyFlavor, SceneError, packed, read_ply_from, write_ply_to};
use crate::stored_zip::{self, StoredZip, add};
use glam::DVec3;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder, ImageFormat, ImageReader, RgbaImage};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{self, BufReader, Cursor, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use thiserror::Error;
use zip::ZipWriter;

/// Version of the layout, and of that of small bundles.
const FORMAT: u32 = 1;
const SMALL_FORMAT: u32 = 2;
/// That of bundles with levels of detail, the latest.
const LEVELS_FORMAT: u32 = 3;
/// Photos that are encoded at once.
const BATCH: usize = 16;
/// Limit on the decoded size of all photos together: this many times the file's size, plus this many bytes. PNG shrinks
/// photos to a third and masked areas to almost nothing.
const MOST_TIMES: u64 = 256;
const MOST_BYTES_MORE: u64 = 1 << 30;

/// Why a bundle cannot be read or written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum BundleError {
    /// The file cannot be opened.
    #[error("cannot read the bundle {}: {source}; check the path", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// The file is something else, or its end is missing.
    #[error("{} is no whole `.ibgs` bundle ({reason}); check the path, copy or export it again", path.display())]
    NoBundle {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A part of the bundle is missing or broken.
    #[error("the bundle {} is damaged: its `{part}` {reason}; copy or export it again", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Name inside the bundle.
        part: String,
        /// What is wrong.
        reason: String,
    },
    /// A later version wrote it.
    #[error("the bundle {} has format {found}, this version of ibgs reads {LEVELS_FORMAT}; use a newer one", path.display())]
    Newer {
        /// The file.
        path: PathBuf,
        /// Its format.
        found: u32,
    },
    /// The Gaussians are not valid.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// Writing failed.
    #[error(transparent)]
    Write(#[from] WriteError),
}

/// Everything that rendering a model needs.
#[derive(Clone, Debug)]
pub struct Bundle {
    /// Iteration that the model was saved at.
    pub iteration: u32,
    /// The Gaussians; where there are levels of detail, the coarsest.
    pub gaussians: Gaussians,
    /// The levels of detail of a bundle that was read with them.
    pub levels: Option<Arc<Levels>>,
    /// The residual network in its module's own form; none without.
    pub network: Option<Vec<u8>>,
    /// The training photos' exposures by name; none where they were not corrected.
    pub exposure: Option<HashMap<String, Exposure>>,
    /// All views' cameras.
    pub cameras: Vec<CameraRecord>,
    /// How it was trained.
    pub config: TrainConfig,
    /// Photos of the training views by name: one for every training camera, of its size.
    pub photos: Vec<(String, HostPhoto)>,
    /// The sources of each view.
    pub sources: Vec<ViewSources>,
}

/// How Gaussians and photos are kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Packing {
    /// Every value as it is.
    #[default]
    Lossless,
    /// Gaussians in the steps of a SOG file, opaque photos as JPEG.
    Small {
        /// JPEG's quality, 1 to 100.
        photo_quality: u8,
    },
    /// Photos without loss, Gaussians with levels of detail, in the coordinates in which they are rendered.
    Levels,
}

#[derive(Serialize, Deserialize)]
struct Header {
    format: u32,
    iteration: u32,
    /// Of a small bundle: where the coordinates of its Gaussians lie in the scene.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    offset: Option<DVec3>,
}

impl Header {
    /// Where a small bundle's Gaussians are.
    fn space(&self) -> LocalSpace {
        LocalSpace::at(self.offset.unwrap_or_default())
    }
}

/// The Gaussians' part, and that of a small bundle.
const CLOUD: &str = "point_cloud.ply";
const SOG: &str = "gaussians.sog";
/// The parts of levels of detail.
const TREE: &str = "levels.json";
const CHUNKS: &str = "levels.bin";
/// The options' part.
const OPTIONS: &str = "config.toml";

fn photo_part(name: &str) -> String {
    format!("photos/{name}.png")
}

fn small_photo_part(name: &str) -> String {
    format!("photos/{name}.jpg")
}

impl Bundle {
    /// Writes the bundle, in one atomic step. Of one that was read with levels of detail only the coarsest would be written:
    /// [`Model::expand`](crate::model::Model::expand) comes first.
    ///
    /// # Errors
    /// [`BundleError::Scene`] for Gaussians that are not valid, [`BundleError::Write`].
    pub fn write(&self, path: &Path, packing: Packing) -> Result<(), BundleError> {
        if self.gaussians.is_empty() && packing == Packing::Levels {
            return Err(SceneError::NoGaussians.into());
        }
        self.gaussians.validate()?;
        write_seekable_atomically(path, |out| stored_zip::write(out, |zip| self.write_parts(zip, packing)))?;
        Ok(())
    }

    fn write_parts<W: Write + Seek>(&self, zip: &mut ZipWriter<W>, packing: Packing) -> io::Result<()> {
        let (format, offset) = match packing {
            Packing::Lossless => (FORMAT, None),
            Packing::Levels => (LEVELS_FORMAT, None),
            Packing::Small { .. } => (SMALL_FORMAT, self.gaussians.space.file_offset()),
        };
        add(zip, "ibgs.json", &serde_json::to_vec(&Header { format, iteration: self.iteration, offset })?)?;
        if let Some(exposure) = &self.exposure {
            // In the order of their names, so that equal bundles have equal bytes.
            let photos: BTreeMap<_, _> = exposure.iter().collect();
            let value = exposure::to_json(photos.into_iter().map(|(name, photo)| (name.as_str(), photo)));
            add(zip, exposure::FILE_NAME, &serde_json::to_vec(&value)?)?;
        }
        add(zip, "cameras.json", &serde_json::to_vec(&cameras::to_json(&self.cameras))?)?;
        add(zip, "multi_view.json", multi_view::to_text(&self.sources)?.as_bytes())?;
        add(zip, OPTIONS, self.config.to_text().map_err(io::Error::other)?.as_bytes())?;
        if packing == Packing::Levels {
            // In the coordinates in which it is rendered.
            let space = model::space(&self.cameras, &self.gaussians, self.config.data.extent);
            let chunks = levels::build(self.gaussians.clone().into_space(space), levels::CHUNK);
            let tree = Tree::of(space, self.gaussians.sh_degree, &chunks);
            add(zip, TREE, &serde_json::to_vec(&tree)?)?;
            stored_zip::add_large(zip, CHUNKS, tree.bytes(), |out| levels::write(&chunks, out))?;
        } else if packing == Packing::Lossless {
            let mut ply = Vec::new();
            write_ply_to(&mut ply, &self.gaussians, PlyFlavor::Full)?;
            add(zip, CLOUD, &ply)?;
        } else {
            let place = LocalSpace::at(offset.unwrap_or_default());
            let [sog, planes] = packed::encode(&self.gaussians.in_space(place)).map_err(io::Error::other)?;
            add(zip, SOG, &sog)?;
            add(zip, "planes.bin", &planes)?;
        }
        if let Some(network) = &self.network {
            add(zip, "network.bin", network)?;
        }
        for photos in self.photos.chunks(BATCH) {
            let encode = |(name, photo): &(String, HostPhoto)| {
                let pixels = photo.pixels().map_err(io::Error::other)?;
                encode(name, &pixels, packing)
            };
            for (part, bytes) in photos.par_iter().map(encode).collect::<io::Result<Vec<_>>>()? {
                add(zip, &part, &bytes)?;
            }
        }
        Ok(())
    }

    /// Makes photos whose longest side has more than `longest` pixels smaller, together with their cameras.
    ///
    /// # Errors
    /// A photo cannot be decoded again.
    pub fn shrink_photos(&mut self, longest: u32) -> Result<(), DatasetError> {
        let is_large = |(_, photo): &&mut (String, HostPhoto)| photo.size().into_iter().any(|side| side > longest);
        self.photos.par_iter_mut().filter(is_large).try_for_each(|(_, photo)| {
            let Photo { width, height, rgba } = Arc::unwrap_or_clone(photo.pixels()?);
            let scale = f64::from(longest) / f64::from(width.max(height));
            let [w, h] = [width, height].map(|side| (scale * f64::from(side)).round().max(1.0) as u32);
            let image = RgbaImage::from_raw(width, height, rgba).expect("a photo has its size");
            let rgba = resample(image, w, h, Resampler::Lanczos3).into_raw();
            *photo = Photo { width: w, height: h, rgba }.into();
            Ok(())
        })?;
        let photos: HashMap<&str, [u32; 2]> =
            self.photos.iter().map(|(name, photo)| (name.as_str(), photo.size())).collect();
        for record in self.cameras.iter_mut().filter(|record| record.split == Some(Split::Train)) {
            let camera = &mut record.camera;
            if let Some(&[width, height]) = photos.get(record.name.as_str())
                && [width, height] != [camera.width, camera.height]
            {
                *camera = camera.resized(width, height);
            }
        }
        Ok(())
    }

    /// Reads a bundle.
    ///
    /// # Errors
    /// [`BundleError`] naming the file and the part that is missing or broken.
    pub fn read(path: &Path) -> Result<Self, BundleError> {
        let unreadable = |source| BundleError::Read { path: path.to_owned(), source };
        Self::read_from(BufReader::new(File::open(path).map_err(unreadable)?), path)
    }

    /// [`Bundle::read`] from anything seekable; `path` is for messages.
    ///
    /// # Errors
    /// As [`Bundle::read`].
    pub fn read_from<R: Read + Seek>(reader: R, path: &Path) -> Result<Self, BundleError> {
        let mut parts = Parts::open(reader, path)?;
        let bundle = parts.bundle(Parts::gaussians)?;
        let photos = parts.photos(&bundle.cameras)?;
        Ok(Self { photos, ..bundle })
    }

    /// What the beginning of a bundle's bytes gives: the model without network and photos. Gaussians of a small bundle have
    /// their constant colours alone, and no planes. None where the beginning is too short, or no bundle.
    ///
    /// # Errors
    /// As [`Bundle::read`].
    pub fn read_start(start: &[u8], path: &Path) -> Result<Option<Self>, BundleError> {
        let Some(archive) = beginning(start).ok().flatten() else { return Ok(None) };
        let bundle = Parts::open(Cursor::new(archive), path)?.bundle(Parts::base_gaussians)?;
        Ok(Some(Self { network: None, ..bundle }))
    }
}

/// An archive of a bundle's first parts, up to what the base image needs of the Gaussians; none where that is not all there, as
/// in bundles of earlier versions, whose Gaussians come first.
fn beginning(start: &[u8]) -> io::Result<Option<Vec<u8>>> {
    let (mut out, mut has_options, mut is_long_enough) = (Cursor::new(Vec::new()), false, false);
    stored_zip::write(&mut out, |zip| {
        for part in stored_zip::first_parts(start) {
            let base = if part.name == SOG { packed::base_of(part.bytes) } else { None };
            match base {
                Some(base) => add(zip, part.name, &base)?,
                None if part.is_whole => add(zip, part.name, part.bytes)?,
                None => break,
            }
            has_options |= part.name == OPTIONS;
            if [SOG, CLOUD].contains(&part.name) {
                is_long_enough = has_options;
                break;
            }
        }
        Ok(())
    })?;
    Ok(is_long_enough.then(|| out.into_inner()))
}

/// The parts of an open bundle.
struct Parts<'a, R> {
    path: &'a Path,
    zip: StoredZip<R>,
}

impl<'a, R: Read + Seek> Parts<'a, R> {
    fn open(reader: R, path: &'a Path) -> Result<Self, BundleError> {
        let no_bundle = |reason: String| BundleError::NoBundle { path: path.to_owned(), reason };
        let zip = StoredZip::open(reader).map_err(no_bundle)?;
        match zip.has("ibgs.json") {
            true => Ok(Self { path, zip }),
            false => Err(no_bundle("it is a ZIP archive of something else".to_owned())),
        }
    }

    /// The Gaussians.
    fn gaussians(&mut self, header: &Header) -> Result<Gaussians, BundleError> {
        if !self.zip.has(SOG) {
            return self.cloud();
        }
        let planes = self.bytes("planes.bin")?;
        let gaussians = self.parse(SOG, |bytes| packed::decode(bytes, &planes))?;
        Ok(Gaussians { space: header.space(), ..gaussians })
    }

    /// The same, as far as the base image needs them.
    fn base_gaussians(&mut self, header: &Header) -> Result<Gaussians, BundleError> {
        if !self.zip.has(SOG) {
            return self.cloud();
        }
        Ok(Gaussians { space: header.space(), ..self.parse(SOG, packed::decode_base)? })
    }

    fn cloud(&mut self) -> Result<Gaussians, BundleError> {
        self.parse(CLOUD, |bytes| read_ply_from(&mut Cursor::new(bytes), bytes.len() as u64, Path::new(CLOUD)))
    }

    /// The levels of detail, whose numbers stay in the file.
    fn levels(&mut self) -> Result<Levels, BundleError> {
        let tree: Tree = self.parse(TREE, |bytes| serde_json::from_slice(bytes))?;
        let place = self.zip.place(CHUNKS).map_err(|reason| self.damaged(CHUNKS, reason))?;
        Levels::open(tree, self.path, place).map_err(|reason| self.damaged(CHUNKS, reason))
    }

    /// The bundle without its photos.
    fn bundle(
        &mut self,
        gaussians: fn(&mut Self, &Header) -> Result<Gaussians, BundleError>,
    ) -> Result<Bundle, BundleError> {
        let header: Header = self.parse("ibgs.json", |bytes| serde_json::from_slice(bytes))?;
        if header.format > LEVELS_FORMAT {
            return Err(BundleError::Newer { path: self.path.to_owned(), found: header.format });
        }
        let levels = self.zip.has(TREE).then(|| self.levels()).transpose()?.map(Arc::new);
        let gaussians = match &levels {
            Some(levels) => {
                levels.gaussians(std::iter::once(0)).map_err(|error| self.damaged(CHUNKS, error.to_string()))?
            }
            None => gaussians(self, &header)?,
        };
        let has_network = self.zip.has("network.bin");
        let network = has_network.then(|| self.bytes("network.bin")).transpose()?;
        let has_exposure = self.zip.has(exposure::FILE_NAME);
        let exposure = has_exposure
            .then(|| self.parse(exposure::FILE_NAME, |bytes| exposure::from_json(&String::from_utf8_lossy(bytes))))
            .transpose()?;
        let cameras = self.parse("cameras.json", |bytes| cameras::from_json(&String::from_utf8_lossy(bytes)))?;
        let sources = self.parse("multi_view.json", |bytes| multi_view::from_text(&String::from_utf8_lossy(bytes)))?;
        let config =
            self.parse(OPTIONS, |bytes| TrainConfig::from_text(&String::from_utf8_lossy(bytes), Path::new(OPTIONS)))?;
        let photos = Vec::new();
        Ok(Bundle {
            iteration: header.iteration,
            gaussians,
            levels,
            network,
            exposure,
            cameras,
            config,
            photos,
            sources,
        })
    }

    fn damaged(&self, part: &str, reason: impl Into<String>) -> BundleError {
        BundleError::Damaged { path: self.path.to_owned(), part: part.to_owned(), reason: reason.into() }
    }

    fn bytes(&mut self, part: &str) -> Result<Vec<u8>, BundleError> {
        self.zip.bytes(part).map_err(|reason| self.damaged(part, reason))
    }

    fn parse<T, E: ToString>(
        &mut self,
        part: &str,
        parse: impl FnOnce(&[u8]) -> Result<T, E>,
    ) -> Result<T, BundleError> {
        let bytes = self.bytes(part)?;
        parse(&bytes).map_err(|error| self.damaged(part, format!("makes no sense ({})", error.to_string())))
    }

    /// The training views' photos, in the order of the cameras.
    fn photos(&mut self, cameras: &[CameraRecord]) -> Result<Vec<(String, HostPhoto)>, BundleError> {
        let mut photos = Vec::new();
        let training: Vec<&CameraRecord> = cameras.iter().filter(|c| c.split == Some(Split::Train)).collect();
        let sizes = training.iter().map(|c| u64::from(c.camera.width).saturating_mul(4 * u64::from(c.camera.height)));
        let needed = sizes.fold(0_u64, u64::saturating_add);
        if needed / MOST_TIMES > self.zip.length().saturating_add(MOST_BYTES_MORE / MOST_TIMES) {
            let reason =
                format!("asks for {needed} bytes of photos, which a file of {} bytes cannot hold", self.zip.length());
            return Err(self.damaged("cameras.json", reason));
        }
        for batch in training.chunks(BATCH) {
            let read = batch.iter().map(|record| {
                let small = small_photo_part(&record.name);
                let (part, format) = match self.zip.has(&small) {
                    true => (small, ImageFormat::Jpeg),
                    false => (photo_part(&record.name), ImageFormat::Png),
                };
                Ok((self.bytes(&part)?, format, part))
            });
            let read = read.collect::<Result<Vec<_>, BundleError>>()?;
            let decode =
                |(record, (bytes, format, _)): (&&CameraRecord, &(Vec<u8>, _, _))| decode(bytes, *format, record);
            let decoded: Vec<_> = batch.par_iter().zip(&read).map(decode).collect();
            for ((record, (_, _, part)), photo) in batch.iter().zip(&read).zip(decoded) {
                let photo = photo.map_err(|reason| self.damaged(part, reason))?;
                photos.push((record.name.clone(), photo.into()));
            }
        }
        Ok(photos)
    }
}

/// A photo's part of the archive, by name and contents. JPEG has no transparency.
fn encode(name: &str, photo: &Photo, packing: Packing) -> io::Result<(String, Vec<u8>)> {
    let mut bytes = Vec::new();
    let opaque = photo.rgba.chunks_exact(4).all(|pixel| pixel[3] == u8::MAX);
    let (width, height) = (photo.width, photo.height);
    let rgb = || -> Vec<u8> { photo.rgba.chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect() };
    let (part, written) = match packing {
        Packing::Small { photo_quality } if opaque => {
            let encoder = JpegEncoder::new_with_quality(&mut bytes, photo_quality);
            (small_photo_part(name), encoder.write_image(&rgb(), width, height, ExtendedColorType::Rgb8))
        }
        _ if opaque => {
            let encoder = PngEncoder::new(&mut bytes);
            (photo_part(name), encoder.write_image(&rgb(), width, height, ExtendedColorType::Rgb8))
        }
        _ => {
            let encoder = PngEncoder::new(&mut bytes);
            (photo_part(name), encoder.write_image(&photo.rgba, width, height, ExtendedColorType::Rgba8))
        }
    };
    written.map_err(io::Error::other)?;
    Ok((part, bytes))
}

/// The photo of a camera, or what is wrong with it.
fn decode(bytes: &[u8], format: ImageFormat, record: &CameraRecord) -> Result<Photo, String> {
    // Before the pixels are decoded.
    let reader = ImageReader::with_format(Cursor::new(bytes), format);
    let (width, height) = reader.into_dimensions().map_err(|error| format!("is no usable picture ({error})"))?;
    let camera = &record.camera;
    if (width, height) != (camera.width, camera.height) {
        return Err(format!("has {width} x {height} pixels, its camera {} x {}", camera.width, camera.height));
    }
    let image = image_io::decode(bytes).map_err(|reason| format!("is no usable picture ({reason})"))?;
    let rgba = image.into_rgba8().into_raw();
    Ok(Photo { width, height, rgba })
}
