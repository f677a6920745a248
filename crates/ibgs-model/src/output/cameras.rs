//! `cameras.json` and `split.json`: the cameras of a run, read back exactly.

use super::OutputError;
use crate::camera::{Camera, MAX_COORDINATE};
use crate::dataset::Dataset;
use crate::files::without_mark;
use crate::local_space::LocalSpace;
use crate::scene::Gaussians;
use glam::{DMat3, DVec2, DVec3};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

/// Side of the split that a view belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Split {
    /// Trains.
    Train,
    /// Held out.
    Test,
}

impl Split {
    /// Name of the folder of its pictures.
    pub fn folder(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Test => "test",
        }
    }
}

/// One view as `cameras.json` keeps it.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraRecord {
    /// Image name with sub-folders and extension.
    pub name: String,
    /// Its camera.
    pub camera: Camera,
    /// Its side; `None` where the file (of another program) does not say.
    pub split: Option<Split>,
}

/// Form of one entry: that of 3D Gaussian splatting, then fields of ours.
#[derive(Serialize, Deserialize)]
struct Entry {
    id: u64,
    img_name: String,
    width: u32,
    height: u32,
    /// Camera centre in world units.
    position: [f64; 3],
    /// Rows of the rotation that takes view directions to world directions.
    rotation: [[f64; 3]; 3],
    fy: f64,
    fx: f64,
    cx: Option<f64>,
    cy: Option<f64>,
    /// As in [`Camera`]; `position` alone would come back with rounding errors.
    translation: Option<[f64; 3]>,
    split: Option<Split>,
}

/// Most pixels of a view, as of an EXR photo and of a frame of a camera path.
const MAX_PIXELS: u64 = 1 << 28;

/// The views of a data set in its order.
pub fn records(dataset: &Dataset) -> Vec<CameraRecord> {
    let mut records: Vec<CameraRecord> = dataset
        .views
        .iter()
        .map(|view| CameraRecord { name: view.name.clone(), camera: view.camera, split: None })
        .collect();
    for (indices, split) in [(&dataset.train, Split::Train), (&dataset.test, Split::Test)] {
        for &index in indices {
            if let Some(record) = records.get_mut(index) {
                record.split = Some(split);
            }
        }
    }
    records
}

/// The local coordinates in which a model is rendered: those of its training, from its cameras and the extent that they were
/// given; without cameras, those of the Gaussians.
pub fn space(cameras: &[CameraRecord], gaussians: &Gaussians, extent: Option<f64>) -> LocalSpace {
    let space = LocalSpace::of_scene(cameras.iter().map(|record| &record.camera), gaussians.positions());
    space.with_extent(extent)
}

/// Contents of `cameras.json`.
pub fn to_json(records: &[CameraRecord]) -> Value {
    let entries = records.iter().zip(0_u64..).map(|(record, id)| {
        let camera = &record.camera;
        let view_from_world = camera.view_from_world;
        json!(Entry {
            id,
            img_name: record.name.clone(),
            width: camera.width,
            height: camera.height,
            position: camera.center().to_array(),
            // The columns of a matrix are the rows of its transpose.
            rotation: view_from_world.to_cols_array_2d(),
            fy: camera.focal.y,
            fx: camera.focal.x,
            cx: Some(camera.principal.x),
            cy: Some(camera.principal.y),
            translation: Some(camera.translation.to_array()),
            split: record.split,
        })
    });
    entries.collect()
}

/// Contents of `split.json`: `{"train": [names], "test": [names]}`.
pub fn split_json(records: &[CameraRecord]) -> Value {
    let names = |split: Split| -> Vec<&str> {
        let of_split = records.iter().filter(|record| record.split == Some(split));
        of_split.map(|record| record.name.as_str()).collect()
    };
    json!({ "train": names(Split::Train), "test": names(Split::Test) })
}

/// Reads a file in the form of `cameras.json`.
///
/// # Errors
/// [`OutputError::Read`], [`OutputError::Damaged`] naming line or camera.
pub fn read(path: &Path) -> Result<Vec<CameraRecord>, OutputError> {
    let text = fs::read_to_string(path).map_err(|source| OutputError::Read { path: path.to_owned(), source })?;
    from_json(&text).map_err(|reason| OutputError::Damaged { path: path.to_owned(), reason })
}

/// Reads the contents of `cameras.json`.
///
/// # Errors
/// One sentence that names the line or the camera.
pub fn from_json(text: &str) -> Result<Vec<CameraRecord>, String> {
    let entries: Vec<Entry> =
        serde_json::from_slice(without_mark(text.as_bytes())).map_err(|error| error.to_string())?;
    entries.into_iter().map(record).collect()
}

fn record(entry: Entry) -> Result<CameraRecord, String> {
    let view_from_world = DMat3::from_cols_array_2d(&entry.rotation);
    let (width, height) = (entry.width, entry.height);
    let translation = match entry.translation {
        Some(translation) => DVec3::from(translation),
        None => -(view_from_world * DVec3::from(entry.position)),
    };
    let camera = Camera {
        width,
        height,
        focal: DVec2::new(entry.fx, entry.fy),
        principal: DVec2::new(entry.cx.unwrap_or(f64::from(width) / 2.0), entry.cy.unwrap_or(f64::from(height) / 2.0)),
        view_from_world,
        translation,
    };
    let single = |focal: f64| focal as f32 > 0.0 && (focal as f32).is_finite();
    let turned = view_from_world * view_from_world.transpose();
    let problem = if width == 0 || height == 0 {
        "an empty image"
    } else if u64::from(width) * u64::from(height) > MAX_PIXELS {
        "an image of more than 2^28 pixels"
    } else if !(single(entry.fx) && single(entry.fy)) {
        "a focal length that is not positive"
    } else if !(camera.principal.as_vec2().is_finite() && translation.abs().max_element() <= MAX_COORDINATE) {
        "a principal point or position out of range"
    } else if !turned.abs_diff_eq(DMat3::IDENTITY, 1e-3) || view_from_world.determinant() < 0.0 {
        "a `rotation` that is no rotation"
    } else {
        return Ok(CameraRecord { name: entry.img_name, camera, split: entry.split });
    };
    Err(format!("camera `{}` has {problem}", entry.img_name))
}
