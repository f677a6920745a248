//! The exposure of any view, predicted from those of the training photos.

use super::Exposure;
use crate::camera::Camera;
use crate::local_space::LocalSpace;
use glam::DMat3;
use serde_json::{Value, json};
use std::collections::HashMap;
use std::sync::{Arc, OnceLock};

/// File of the exposures, beside the point cloud of their iteration.
pub const FILE_NAME: &str = "exposure.json";

/// The weight of a photo is one over this power of its distance in position and direction.
const POWER: i32 = 4;
/// Least such distance at which two photos count as different.
const CLOSE: f64 = 1e-4;

/// The exposures of the training photos, and predictions from them for other views.
///
/// Automatic exposure depends on what the camera sees, so a view's exposure is close to that of the photos around it.
/// The prediction is their mean, weighted by position and direction, times a factor from 0 to 1 for gains and one for
/// offsets. The factors say how far to trust the mean: they are fitted by least squares on the training photos, each
/// predicted from the others. Where exposures were set at random they are about 0, and a view gets the mean exposure,
/// which is no correction.
#[derive(Clone, Debug)]
pub struct ExposureField {
    cameras: Arc<[Camera]>,
    photos: Vec<Exposure>,
    /// Scene units of one unit of a distance.
    unit: f64,
    /// Factors on predicted log gains and offsets. Computed at first use, in time quadratic in the number of photos.
    trust: OnceLock<[f64; 2]>,
}

impl ExposureField {
    /// For the training cameras, in the scene's coordinates, and their photos' exposures.
    ///
    /// # Panics
    /// When these are not as many: a bug of ours.
    pub fn new(cameras: Arc<[Camera]>, photos: Vec<Exposure>) -> Self {
        assert_eq!(cameras.len(), photos.len(), "an exposure for every camera");
        let unit = LocalSpace::of_cameras(cameras.iter()).unwrap_or_default().scale;
        Self { cameras, photos, unit, trust: OnceLock::new() }
    }

    fn measured_trust(&self) -> [f64; 2] {
        let mut products = [[0.0f64; 2]; 2];
        for (index, (camera, own)) in self.cameras.iter().zip(&self.photos).enumerate() {
            let others = self.around(camera, Some(index));
            for (sums, (own, others)) in products.iter_mut().zip(channels(own).into_iter().zip(channels(&others))) {
                for (own, other) in own.into_iter().zip(others.map(f64::from)) {
                    sums[0] += f64::from(own) * other;
                    sums[1] += other * other;
                }
            }
        }
        products.map(|[with, own]| if own > 0.0 { (with / own).clamp(0.0, 1.0) } else { 0.0 })
    }

    /// The same photos, but every view in their mean exposure.
    pub fn levelled(self) -> Self {
        Self { cameras: Arc::default(), ..self }
    }

    /// The exposures of the training photos.
    pub fn photos(&self) -> &[Exposure] {
        &self.photos
    }

    /// The exposure of a view: a training photo's own; of any other view, what the photos around it predict.
    pub fn at(&self, camera: &Camera) -> Exposure {
        if let Some(own) = self.cameras.iter().position(|other| other.has_pose_of(camera)) {
            return self.photos[own];
        }
        let mean = self.around(camera, None);
        let part = |values: [f32; 3], trust: f64| values.map(|v| (f64::from(v) * trust) as f32);
        let [gains, offsets] = self.trust();
        Exposure { log_gain: part(mean.log_gain, gains), offset: part(mean.offset, offsets) }
    }

    /// Factors, 0 to 1, on the neighbours' log gains and offsets in a prediction.
    pub fn trust(&self) -> [f64; 2] {
        *self.trust.get_or_init(|| self.measured_trust())
    }

    /// Root mean square of the photos' log gains: how much they differ, as a part of their brightness.
    pub fn spread(&self) -> f64 {
        let squares: f64 = self.photos.iter().flat_map(|photo| photo.log_gain).map(|v| f64::from(v).powi(2)).sum();
        (squares / (3 * self.photos.len()).max(1) as f64).sqrt()
    }

    /// Mean of the exposures of all photos but one, weighted by position and direction.
    fn around(&self, camera: &Camera, without: Option<usize>) -> Exposure {
        let (mut sum, mut weights) = ([[0.0f64; 3]; 2], 0.0);
        for (index, (other, exposure)) in self.cameras.iter().zip(&self.photos).enumerate() {
            if Some(index) == without {
                continue;
            }
            let weight = pose_difference(camera, other, self.unit).max(CLOSE).powi(-POWER);
            weights += weight;
            for (sum, values) in sum.iter_mut().zip(channels(exposure)) {
                sum.iter_mut().zip(values).for_each(|(sum, v)| *sum += weight * f64::from(v));
            }
        }
        let [log_gain, offset] = sum.map(|sum| sum.map(|v| if weights > 0.0 { (v / weights) as f32 } else { 0.0 }));
        Exposure { log_gain, offset }
    }
}

fn channels(exposure: &Exposure) -> [[f32; 3]; 2] {
    [exposure.log_gain, exposure.offset]
}

/// Mean absolute entry of `T_source T_target^-1 - I` over its 16 entries, places in units of this many scene units.
fn pose_difference(target: &Camera, source: &Camera, unit: f64) -> f64 {
    let rotation = source.view_from_world * target.view_from_world.transpose();
    let translation = (source.translation - rotation * target.translation) / unit;
    let turned = (rotation - DMat3::IDENTITY).to_cols_array();
    (turned.iter().map(|v| v.abs()).sum::<f64>() + translation.abs().element_sum()) / 16.0
}

/// Contents of the file: for each photo's name the three rows of `[A | t]` of `A color + t`, as 3D Gaussian splatting has them.
pub fn to_json<'a>(photos: impl Iterator<Item = (&'a str, &'a Exposure)>) -> Value {
    let rows = |e: &Exposure| -> Value {
        let row = |c: usize| {
            let mut row = [0.0; 4];
            (row[c], row[3]) = (f64::from(e.log_gain[c]).exp(), f64::from(e.offset[c]));
            json!(row)
        };
        Value::Array((0..3).map(row).collect())
    };
    Value::Object(photos.map(|(name, exposure)| (name.to_owned(), rows(exposure))).collect())
}

/// Reads the contents of the file.
///
/// # Errors
/// One sentence that names the photo.
pub fn from_json(text: &str) -> Result<HashMap<String, Exposure>, String> {
    let all: HashMap<String, [[f64; 4]; 3]> = serde_json::from_str(text).map_err(|error| error.to_string())?;
    all.into_iter()
        .map(|(name, rows)| {
            let is_diagonal = (0..9).all(|i| i / 3 == i % 3 || rows[i / 3][i % 3] == 0.0);
            let exposure = Exposure {
                log_gain: std::array::from_fn(|c| rows[c][c].ln() as f32),
                offset: std::array::from_fn(|c| rows[c][3] as f32),
            };
            match is_diagonal && exposure.is_finite() {
                true => Ok((name, exposure)),
                false => Err(format!("the exposure of `{name}` is not a positive gain and an offset for each channel")),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec2, DVec3};

    fn camera(x: f64) -> Camera {
        Camera {
            width: 16,
            height: 12,
            focal: DVec2::splat(12.0),
            principal: DVec2::new(8.0, 6.0),
            view_from_world: DMat3::IDENTITY,
            translation: DVec3::new(-x, 0.0, 0.0),
        }
    }

    fn field(exposures: impl Fn(usize) -> f32) -> ExposureField {
        let cameras: Vec<Camera> = (0..20).map(|i| camera(f64::from(i))).collect();
        let photos = (0..20)
            .map(|i| Exposure {
                log_gain: [exposures(i), 0.5 * exposures(i), 0.0],
                offset: [0.0, 0.0, 0.1 * exposures(i)],
            })
            .collect();
        ExposureField::new(cameras.into(), photos)
    }

    #[test]
    fn what_changes_smoothly_is_predicted() {
        let smooth = |i: usize| 0.3 * (i as f32 * 0.5).sin();
        let field = field(smooth);
        assert!(field.trust().iter().all(|t| *t > 0.9), "{:?}", field.trust());
        for i in 1..18 {
            let between = field.at(&camera(i as f64 + 0.5)).log_gain[0];
            let expected = 0.3 * ((i as f32 + 0.5) * 0.5).sin();
            assert!((between - expected).abs() < 0.06, "{i}: {between} against {expected}");
        }
        assert_eq!(field.at(&camera(7.0)), field.photos()[7], "a photo's own exposure");
        assert_eq!(field.at(&camera(7.5)).offset[0], 0.0);
        let levelled = field.clone().levelled();
        assert_eq!((levelled.at(&camera(7.0)), levelled.photos()), (Exposure::default(), field.photos()));
    }

    #[test]
    fn what_is_random_is_not_trusted() {
        let field = field(|i| if (i * 7919 + i * i * 31) % 251 > 125 { 0.3 } else { -0.3 });
        assert!(field.trust()[0] < 0.5, "{:?}", field.trust());
        assert!((field.spread() - 0.3 * (1.25f64 / 3.0).sqrt()).abs() < 1e-6, "{}", field.spread());
        let alone =
            ExposureField::new(vec![camera(0.0)].into(), vec![Exposure { log_gain: [0.5; 3], ..Default::default() }]);
        assert_eq!(alone.at(&camera(3.0)), Exposure::default());
        assert_eq!(ExposureField::new(Vec::new().into(), Vec::new()).at(&camera(0.0)), Exposure::default());
    }

    #[test]
    fn the_file_keeps_them() {
        let exposure = Exposure { log_gain: [0.25, -0.5, 0.0], offset: [0.01, 0.0, -0.02] };
        let text = to_json([("a/b.jpg", &exposure)].into_iter()).to_string();
        let read = from_json(&text).unwrap()["a/b.jpg"];
        let near = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
        assert!(near(read.log_gain, exposure.log_gain) && read.offset == exposure.offset, "{read:?}");
        for rows in ["[[1,0.1,0,0],[0,1,0,0],[0,0,1,0]]", "[[-1,0,0,0],[0,1,0,0],[0,0,1,0]]", "[[1,0,0,0]]", "3"] {
            let error = from_json(&format!("{{\"x.jpg\": {rows}}}")).unwrap_err();
            assert!(!error.is_empty(), "{rows}");
        }
    }
}
