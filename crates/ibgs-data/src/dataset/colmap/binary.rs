//! COLMAP's binary files, little endian. No count in them is trusted before it is compared with the file's length.

use super::sparse::{SparsePoint, distinct};
use super::{CameraRecord, ImageRecord, MODELS, model_by_id};
use crate::dataset::Point;
use crate::dataset::error::DatasetError;
use glam::{DVec2, DVec3};
use std::collections::BTreeMap;
use std::path::Path;

/// Smallest sizes in bytes of a record: a camera without parameters (a model that is not known may have any number), an
/// image with an empty name and no points, a point without track.
const CAMERA_BYTES: u64 = 4 + 4 + 8 + 8;
const IMAGE_BYTES: u64 = 4 + 7 * 8 + 4 + 1 + 8;
const POINT_BYTES: u64 = 8 + 3 * 8 + 3 + 8 + 8;
/// An observation in an image (x, y, point id) and an element of a point's track (image id, index).
const OBSERVATION_BYTES: u64 = 24;
const TRACK_BYTES: u64 = 8;

/// Reads a byte slice front to back and knows where it is.
struct Reader<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    offset: usize,
}

impl<'a> Reader<'a> {
    fn new(path: &'a Path, bytes: &'a [u8]) -> Reader<'a> {
        Reader { path, bytes, offset: 0 }
    }

    fn rest(&self) -> &'a [u8] {
        self.bytes.get(self.offset..).unwrap_or_default()
    }

    fn take<const N: usize>(&mut self, what: &'static str) -> Result<[u8; N], DatasetError> {
        match self.rest().first_chunk::<N>() {
            Some(chunk) => {
                self.offset += N;
                Ok(*chunk)
            }
            None => Err(self.truncated(what)),
        }
    }

    fn truncated(&self, what: &'static str) -> DatasetError {
        DatasetError::Truncated { path: self.path.to_owned(), offset: self.bytes.len(), what }
    }

    fn u32(&mut self, what: &'static str) -> Result<u32, DatasetError> {
        self.take(what).map(u32::from_le_bytes)
    }

    fn u64(&mut self, what: &'static str) -> Result<u64, DatasetError> {
        self.take(what).map(u64::from_le_bytes)
    }

    fn f64s<const N: usize>(&mut self, what: &'static str) -> Result<[f64; N], DatasetError> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = f64::from_le_bytes(self.take(what)?);
        }
        Ok(values)
    }

    /// A count of records that take at least `bytes_each`, checked against what is left of the file.
    fn count(&mut self, what: &'static str, bytes_each: u64) -> Result<usize, DatasetError> {
        let offset = self.offset;
        let claimed = self.u64(what)?;
        let room = self.rest().len() as u64 / bytes_each;
        if claimed > room {
            let path = self.path.to_owned();
            return Err(DatasetError::Count { path, offset, what, claimed, room });
        }
        Ok(claimed as usize)
    }

    /// A counted list as it is.
    fn list(&mut self, what: &'static str, bytes_each: u64) -> Result<&'a [u8], DatasetError> {
        let bytes = self.count(what, bytes_each)? * bytes_each as usize;
        let list = &self.rest()[..bytes];
        self.offset += bytes;
        Ok(list)
    }

    /// A name that ends with a zero byte.
    fn name(&mut self) -> Result<String, DatasetError> {
        let what = "an image name";
        let length = self.rest().iter().position(|byte| *byte == 0);
        let length = length.ok_or_else(|| self.truncated(what))?;
        let name = std::str::from_utf8(&self.rest()[..length])
            .map_err(|_| DatasetError::byte(self.path, self.offset, "the image name is not UTF-8"))?;
        self.offset += length + 1;
        Ok(name.to_owned())
    }

    fn finish(&self, what: &'static str, count: usize) -> Result<(), DatasetError> {
        match self.rest().len() {
            0 => Ok(()),
            left => {
                let (path, offset) = (self.path.to_owned(), self.offset);
                Err(DatasetError::Trailing { path, offset, what, count, left })
            }
        }
    }
}

/// Reads `cameras.bin`.
pub(super) fn cameras(path: &Path, bytes: &[u8]) -> Result<BTreeMap<u32, CameraRecord>, DatasetError> {
    let mut reader = Reader::new(path, bytes);
    let count = reader.count("cameras", CAMERA_BYTES)?;
    let mut cameras = BTreeMap::new();
    for _ in 0..count {
        let id = reader.u32("a camera id")?;
        let at = reader.offset;
        let number = reader.u32("a camera model")? as i32;
        let Some((model, param_count)) = model_by_id(number) else {
            return Err(DatasetError::CameraModel {
                path: path.to_owned(),
                camera: format!("camera {id} at byte {at}"),
                model: format!("number {number} (COLMAP up to 4.1 has 0 to {})", MODELS.len() - 1),
            });
        };
        let width = reader.u64("a camera width")?;
        let height = reader.u64("a camera height")?;
        let mut params = Vec::with_capacity(param_count);
        for _ in 0..param_count {
            params.extend(reader.f64s::<1>("the camera parameters")?);
        }
        if cameras.insert(id, CameraRecord { model, width, height, params }).is_some() {
            return Err(DatasetError::byte(path, at, format!("camera {id} is listed twice")));
        }
    }
    reader.finish("cameras", count)?;
    Ok(cameras)
}

/// The observations of an image in `images.bin`, 24 bytes each.
pub(super) type Raw<'a> = &'a [u8];

/// The number and the place of each observation that has a point.
pub(super) fn observations(raw: Raw<'_>) -> Vec<(u64, DVec2)> {
    let number = |bytes: &[u8; 24], at: usize| u64::from_le_bytes(std::array::from_fn(|i| bytes[8 * at + i]));
    let all = raw.as_chunks::<24>().0.iter();
    let read = |bytes| {
        let at = DVec2::new(f64::from_bits(number(bytes, 0)), f64::from_bits(number(bytes, 1)));
        (number(bytes, 2), at)
    };
    all.map(read).filter(|(point, at)| *point != u64::MAX && at.is_finite()).collect()
}

/// Reads `images.bin`, each image with its observations as they are.
pub(super) fn images<'a>(path: &'a Path, bytes: &'a [u8]) -> Result<Vec<(ImageRecord, Raw<'a>)>, DatasetError> {
    let mut reader = Reader::new(path, bytes);
    let count = reader.count("images", IMAGE_BYTES)?;
    let mut images = Vec::with_capacity(count);
    for _ in 0..count {
        reader.u32("an image id")?;
        let quaternion = reader.f64s("an image rotation")?;
        let translation = reader.f64s("an image translation")?;
        let camera = reader.u32("an image's camera id")?;
        let name = reader.name()?;
        let raw = reader.list("observations", OBSERVATION_BYTES)?;
        images.push((ImageRecord { name, camera, quaternion, translation }, raw));
    }
    reader.finish("images", count)?;
    Ok(images)
}

/// Reads `points3D.bin`.
pub(super) fn points(path: &Path, bytes: &[u8]) -> Result<Vec<SparsePoint>, DatasetError> {
    let mut reader = Reader::new(path, bytes);
    let count = reader.count("points", POINT_BYTES)?;
    let mut points = Vec::with_capacity(count);
    for _ in 0..count {
        let id = reader.u64("a point id")?;
        let position = DVec3::from_array(reader.f64s("a point position")?);
        let color = reader.take("a point colour")?;
        let [error] = reader.f64s("a point error")?;
        let mut track = vec![0; reader.count("track elements", TRACK_BYTES)?];
        for image in &mut track {
            *image = reader.u32("a track's image id")?;
            reader.u32("a track's observation")?;
        }
        points.push(SparsePoint { id, point: Point { position, color }, error, images: distinct(track) });
    }
    reader.finish("points", count)?;
    Ok(points)
}
