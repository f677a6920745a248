//! COLMAP's text files. Lines count from 1; blank lines and lines that start with `#` are comments.

use super::sparse::{SparsePoint, distinct};
use super::{CameraRecord, ImageRecord, model_by_name};
use crate::dataset::Point;
use crate::dataset::error::{DatasetError, without_mark};
use glam::{DVec2, DVec3};
use std::collections::BTreeMap;
use std::path::Path;
use std::str::{FromStr, SplitWhitespace, Utf8Error};

/// The fields of one line.
struct Fields<'a> {
    path: &'a Path,
    line: usize,
    rest: SplitWhitespace<'a>,
}

impl<'a> Fields<'a> {
    fn new(path: &'a Path, line: usize, text: &'a str) -> Fields<'a> {
        Fields { path, line, rest: text.split_whitespace() }
    }

    fn error(&self, problem: String) -> DatasetError {
        DatasetError::line(self.path, self.line, problem)
    }

    fn text(&mut self, what: &str) -> Result<&'a str, DatasetError> {
        self.rest.next().ok_or_else(|| self.error(format!("{what} is missing")))
    }

    fn number<T: FromStr>(&mut self, what: &str) -> Result<T, DatasetError> {
        let text = self.text(what)?;
        text.parse().map_err(|_| self.error(format!("{what} `{text}` is not a valid number")))
    }

    /// Numbers that may be NaN or infinite, also as Windows programs print them.
    fn reals<const N: usize>(&mut self, what: &str) -> Result<[f64; N], DatasetError> {
        let mut values = [0.0; N];
        for value in &mut values {
            let text = self.text(what)?;
            *value = real(text).ok_or_else(|| self.error(format!("{what} `{text}` is not a valid number")))?;
        }
        Ok(values)
    }

    fn numbers<T: FromStr + Default + Copy, const N: usize>(&mut self, what: &str) -> Result<[T; N], DatasetError> {
        let mut values = [T::default(); N];
        for value in &mut values {
            *value = self.number(what)?;
        }
        Ok(values)
    }
}

/// A number; `-nan(ind)`, `1.#QNAN` and the like are NaN, `1.#INF` too.
fn real(text: &str) -> Option<f64> {
    let is_nan = || {
        let bare = text.trim_start_matches(['-', '+']).to_ascii_lowercase();
        let starts = |words: &[&str]| words.iter().any(|word| bare.starts_with(word));
        (starts(&["nan("]) && bare.ends_with(')')) || starts(&["1.#ind", "1.#qnan", "1.#snan", "1.#inf"])
    };
    text.parse().ok().or_else(|| is_nan().then_some(f64::NAN))
}

fn text<'a>(path: &Path, bytes: &'a [u8]) -> Result<&'a str, DatasetError> {
    let text = without_mark(bytes);
    let mark = bytes.len() - text.len();
    let not_utf8 = |cause: Utf8Error| DatasetError::byte(path, mark + cause.valid_up_to(), "the text is not UTF-8");
    std::str::from_utf8(text).map_err(not_utf8)
}

fn is_comment(line: &str) -> bool {
    let line = line.trim_start();
    line.is_empty() || line.starts_with('#')
}

/// Numbered lines without comments.
fn records(text: &str) -> impl Iterator<Item = (usize, &str)> {
    (1..).zip(text.lines()).filter(|(_, line)| !is_comment(line))
}

/// Reads `cameras.txt`: `CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]`.
pub(super) fn cameras(path: &Path, bytes: &[u8]) -> Result<BTreeMap<u32, CameraRecord>, DatasetError> {
    let text = text(path, bytes)?;
    let mut cameras = BTreeMap::new();
    for (number, line) in records(text) {
        let mut fields = Fields::new(path, number, line);
        let id: u32 = fields.number("the camera id")?;
        let name = fields.text("the camera model")?;
        let Some((model, param_count)) = model_by_name(name) else {
            return Err(DatasetError::CameraModel {
                path: path.to_owned(),
                camera: format!("camera {id} in line {number}"),
                model: name.to_owned(),
            });
        };
        let width = fields.number("the camera width")?;
        let height = fields.number("the camera height")?;
        let mut params = Vec::with_capacity(param_count);
        for index in 1..=param_count {
            params.extend(fields.reals::<1>(&format!("{model} parameter {index} of {param_count}"))?);
        }
        if fields.rest.next().is_some() {
            return Err(fields.error(format!("{model} has more than {param_count} parameters")));
        }
        if cameras.insert(id, CameraRecord { model, width, height, params }).is_some() {
            return Err(DatasetError::line(path, number, format!("camera {id} is listed twice")));
        }
    }
    Ok(cameras)
}

/// The observations of an image in `images.txt`: a line and its number.
pub(super) type Raw<'a> = (usize, &'a str);

/// The number and the place of each observation that has a point.
pub(super) fn observations(path: &Path, (number, line): Raw<'_>) -> Result<Vec<(u64, DVec2)>, DatasetError> {
    let mut fields = Fields::new(path, number, line);
    let mut found = Vec::new();
    while fields.rest.clone().next().is_some() {
        let at = DVec2::from_array(fields.reals("a pixel of an observation")?);
        // -1 where it has none.
        let point: i64 = fields.number("an observation's point id")?;
        found.extend(u64::try_from(point).ok().filter(|_| at.is_finite()).map(|point| (point, at)));
    }
    Ok(found)
}

/// Reads `images.txt`, two lines an image: `IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME`, then the observations,
/// a line that may be blank.
pub(super) fn images<'a>(path: &Path, bytes: &'a [u8]) -> Result<Vec<(ImageRecord, Raw<'a>)>, DatasetError> {
    let text = text(path, bytes)?;
    let mut images = Vec::new();
    let mut lines = (1..).zip(text.lines());
    while let Some((number, line)) = lines.next() {
        if is_comment(line) {
            continue;
        }
        let mut fields = Fields::new(path, number, line);
        fields.number::<u32>("the image id")?;
        let quaternion = fields.reals("the image rotation")?;
        let translation = fields.reals("the image translation")?;
        let camera = fields.number("the camera id")?;
        let name = name_field(line);
        if name.is_empty() {
            return Err(DatasetError::line(path, number, "the image name is missing"));
        }
        // Without this check a file that lacks the observation lines would lose every second image.
        let raw = lines.next().unwrap_or((number, ""));
        if raw.1.split_whitespace().count() % 3 != 0 {
            let number = raw.0;
            let problem = "expected the observations of the image above, triples of X Y POINT3D_ID (the line may be \
                           blank but not absent)";
            return Err(DatasetError::line(path, number, problem));
        }
        images.push((ImageRecord { name: name.to_owned(), camera, quaternion, translation }, raw));
    }
    Ok(images)
}

/// The image name: all that follows the ninth field, since names may hold spaces.
fn name_field(line: &str) -> &str {
    let mut rest = line.trim();
    for _ in 0..9 {
        rest = rest.split_once(char::is_whitespace).map_or("", |(_, rest)| rest.trim_start());
    }
    rest
}

/// Reads `points3D.txt`: `POINT3D_ID X Y Z R G B ERROR TRACK[]`, where the track is pairs of IMAGE_ID POINT2D_IDX.
pub(super) fn points(path: &Path, bytes: &[u8]) -> Result<Vec<SparsePoint>, DatasetError> {
    let text = text(path, bytes)?;
    let mut points = Vec::new();
    for (number, line) in records(text) {
        let mut fields = Fields::new(path, number, line);
        let id = fields.number("the point id")?;
        let position = DVec3::from_array(fields.reals("the point position")?);
        let color = fields.numbers("the point colour")?;
        let [error] = fields.reals("the point error")?;
        let mut track = Vec::new();
        while fields.rest.clone().next().is_some() {
            track.push(fields.number("an image id of the track")?);
            fields.number::<u32>("an observation of the track")?;
        }
        points.push(SparsePoint { id, point: Point { position, color }, error, images: distinct(track) });
    }
    Ok(points)
}
