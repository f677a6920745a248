//! How a scene is loaded: photo size, photo folder, split, principal point.

use super::DatasetError;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

/// Photo size to train at, in the numbers of the published command line: 1, 2, 4, 8 divide, a larger number is
/// the width in pixels, -1 caps the width at 1600.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "i64", into = "i64")]
pub enum Resolution {
    /// Divides width and height by 1, 2, 4 or 8, each rounded to the nearest pixel.
    Factor(u32),
    /// Width in pixels; the height keeps the shape. Narrower photos keep their size.
    Width(u32),
    /// Width of 1600 pixels for wider photos: the published rule, written `-1`.
    PublishedCap,
}

/// Width that [`Resolution::PublishedCap`] reduces photos to.
const PUBLISHED_WIDTH_CAP: u32 = 1600;

impl Default for Resolution {
    fn default() -> Self {
        Resolution::Factor(1)
    }
}

impl TryFrom<i64> for Resolution {
    type Error = DatasetError;

    fn try_from(number: i64) -> Result<Self, DatasetError> {
        match (number, u32::try_from(number)) {
            (-1, _) => Ok(Resolution::PublishedCap),
            (_, Ok(factor @ (1 | 2 | 4 | 8))) => Ok(Resolution::Factor(factor)),
            (_, Ok(width)) if width > 8 => Ok(Resolution::Width(width)),
            _ => Err(resolution_error(&number.to_string())),
        }
    }
}

impl From<Resolution> for i64 {
    fn from(resolution: Resolution) -> i64 {
        match resolution {
            Resolution::Factor(number) | Resolution::Width(number) => i64::from(number),
            Resolution::PublishedCap => -1,
        }
    }
}

impl FromStr for Resolution {
    type Err = DatasetError;

    fn from_str(text: &str) -> Result<Self, DatasetError> {
        let number: i64 = text.trim().parse().map_err(|_| resolution_error(text))?;
        Resolution::try_from(number)
    }
}

impl fmt::Display for Resolution {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        i64::from(*self).fmt(f)
    }
}

fn resolution_error(value: &str) -> DatasetError {
    DatasetError::Option {
        option: "data.resolution",
        value: value.to_owned(),
        allowed: "1, 2, 4 or 8 to divide, a larger number for the width in pixels, or -1 to cap the width at 1600",
    }
}

/// Which principal point the cameras get.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PrincipalPoint {
    /// The calibrated one.
    #[default]
    True,
    /// The image centre, as the published code assumes (method.md section 9): for like-for-like comparison only.
    Centred,
}

impl FromStr for PrincipalPoint {
    type Err = DatasetError;

    fn from_str(text: &str) -> Result<Self, DatasetError> {
        match text.trim() {
            "true" => Ok(PrincipalPoint::True),
            "centred" | "centered" => Ok(PrincipalPoint::Centred),
            _ => Err(DatasetError::Option {
                option: "data.principal-point",
                value: text.to_owned(),
                allowed: "`true` or `centred`",
            }),
        }
    }
}

impl fmt::Display for PrincipalPoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            PrincipalPoint::True => "true",
            PrincipalPoint::Centred => "centred",
        })
    }
}

/// How photos are made smaller. The choice moves PSNR, so figures state it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Resampler {
    /// Lanczos with three lobes.
    #[default]
    Lanczos3,
    /// Cubic (Catmull-Rom), as the published code: for like-for-like comparison.
    Bicubic,
}

impl FromStr for Resampler {
    type Err = DatasetError;

    fn from_str(text: &str) -> Result<Self, DatasetError> {
        match text.trim() {
            "lanczos3" => Ok(Resampler::Lanczos3),
            "bicubic" => Ok(Resampler::Bicubic),
            _ => Err(DatasetError::Option {
                option: "data.resampler",
                value: text.to_owned(),
                allowed: "`lanczos3` or `bicubic`",
            }),
        }
    }
}

impl fmt::Display for Resampler {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Resampler::Lanczos3 => "lanczos3",
            Resampler::Bicubic => "bicubic",
        })
    }
}

/// What the alpha channel of a photo means.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Alpha {
    /// Pixels under one half are masked: they leave losses and metrics, and no other view reads them.
    Mask,
    /// The photo lies over the background: alpha says how much of a pixel it covers.
    Composite,
    /// The photo has no alpha and lies on one colour, as other programs cut objects out: what of that colour touches the edge of
    /// the photo is empty.
    Keyed,
}

impl Alpha {
    /// Whether it says how much of each pixel an object covers, with nothing around it.
    pub fn is_cover(self) -> bool {
        self != Alpha::Mask
    }
}

impl FromStr for Alpha {
    type Err = DatasetError;

    fn from_str(text: &str) -> Result<Self, DatasetError> {
        match text.trim() {
            "mask" => Ok(Alpha::Mask),
            "composite" => Ok(Alpha::Composite),
            "keyed" => Ok(Alpha::Keyed),
            _ => Err(DatasetError::Option {
                option: "data.alpha",
                value: text.to_owned(),
                allowed: "`mask`, `composite` or `keyed`",
            }),
        }
    }
}

/// What lies outside of the masks (files or alpha channels).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Masks {
    /// Anything: pixels under one half leave losses and metrics.
    #[default]
    Ignore,
    /// Nothing: the photos show an object over the background. Photos without a mask show their object in every pixel.
    Object,
}

impl FromStr for Masks {
    type Err = DatasetError;

    fn from_str(text: &str) -> Result<Self, DatasetError> {
        match text.trim() {
            "ignore" => Ok(Masks::Ignore),
            "object" => Ok(Masks::Object),
            _ => Err(DatasetError::Option {
                option: "data.masks",
                value: text.to_owned(),
                allowed: "`ignore` or `object`",
            }),
        }
    }
}

/// What a training begins with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum InitialPoints {
    /// The scene's own points and, unless the photos show an object, those found in the photos; where it has none, as with `Photos`.
    #[default]
    Auto,
    /// The scene's own points alone; where it has none, as with `Photos`.
    Scene,
    /// Points found in the photos: in the visual hull of an object, else where photos agree on a depth; random ones where too few
    /// are found.
    Photos,
    /// Random points in front of the cameras.
    Random,
}

impl FromStr for InitialPoints {
    type Err = DatasetError;

    fn from_str(text: &str) -> Result<Self, DatasetError> {
        match text.trim() {
            "auto" => Ok(InitialPoints::Auto),
            "scene" => Ok(InitialPoints::Scene),
            "photos" => Ok(InitialPoints::Photos),
            "random" => Ok(InitialPoints::Random),
            _ => Err(DatasetError::Option {
                option: "data.initial-points",
                value: text.to_owned(),
                allowed: "`auto`, `scene`, `photos` or `random`",
            }),
        }
    }
}

/// What the values of a photo mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ColorSpace {
    /// They are taken as they are.
    Srgb,
    /// Linear light: converted to sRGB before they become 8 bits.
    Linear,
}

impl FromStr for ColorSpace {
    type Err = DatasetError;

    fn from_str(text: &str) -> Result<Self, DatasetError> {
        match text.trim() {
            "srgb" => Ok(ColorSpace::Srgb),
            "linear" => Ok(ColorSpace::Linear),
            _ => Err(DatasetError::Option {
                option: "data.color-space",
                value: text.to_owned(),
                allowed: "`srgb` or `linear`",
            }),
        }
    }
}

/// How to load a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LoadOptions {
    /// Photo size.
    pub resolution: Resolution,
    /// How photos are made smaller.
    pub resampler: Resampler,
    /// Photo folder inside the scene, `.` for the scene folder itself; `images` when absent.
    pub images: Option<String>,
    /// Caps the longer side, in pixels, after `resolution`.
    pub max_resolution: Option<u32>,
    /// Holds out test views.
    pub eval: bool,
    /// With `eval`, every n-th view of the name-sorted list, from the first on, is held out (published: 8).
    pub eval_split_every: usize,
    /// The split of a file like `split.json`, in place of the scene's own. Views that it does not name are not loaded, nor points
    /// that none of its training views shows.
    pub split: Option<PathBuf>,
    /// Which principal point the cameras get.
    pub principal_point: PrincipalPoint,
    /// What lies outside of the masks.
    pub masks: Masks,
    /// What the photos' alpha means; unset: `Composite` in Blender scenes with alpha, `Keyed` where all photos lie on one colour, else
    /// `Mask`, and always with [`Masks::Object`].
    pub alpha: Option<Alpha>,
    /// What the photos' values mean; unset: `Linear` in EXR files, `Srgb` in others.
    pub color_space: Option<ColorSpace>,
    /// Leaves out points of a COLMAP model with a reprojection error over 2 pixels or fewer than 3 images (method.md
    /// section 10.9).
    pub filter_points: bool,
    /// [`Dataset::extent`](super::Dataset::extent).
    pub extent: Option<f64>,
    /// What a training begins with.
    pub initial_points: InitialPoints,
    /// Seed of the random points.
    pub seed: u64,
    /// Number of points that are made where the scene has none; in a hull at most 150 for each photo.
    pub random_points: usize,
    /// Bytes of memory for decoded photos; none: all are kept. Beyond it those used longest ago are decoded again when needed.
    pub host_memory: Option<u64>,
}

impl Default for LoadOptions {
    fn default() -> Self {
        LoadOptions {
            resolution: Resolution::default(),
            resampler: Resampler::default(),
            images: None,
            max_resolution: None,
            eval: false,
            eval_split_every: 8,
            split: None,
            principal_point: PrincipalPoint::True,
            masks: Masks::Ignore,
            alpha: None,
            color_space: None,
            filter_points: false,
            extent: None,
            initial_points: InitialPoints::Auto,
            seed: 0,
            random_points: 100_000,
            host_memory: None,
        }
    }
}

impl LoadOptions {
    /// Whether the photos show an object with nothing around it.
    pub(crate) fn shows_object(&self) -> bool {
        self.masks == Masks::Object || self.alpha.is_some_and(Alpha::is_cover)
    }

    /// Refuses values that no scene can be loaded with.
    pub(crate) fn check(&self) -> Result<(), DatasetError> {
        let refuse = |option, value: String, allowed| Err(DatasetError::Option { option, value, allowed });
        match self {
            LoadOptions { resolution: Resolution::Factor(0) | Resolution::Width(0), .. } => Err(resolution_error("0")),
            LoadOptions { max_resolution: Some(0), .. } => {
                refuse("data.max-resolution", "0".into(), "at least 1 pixel")
            }
            LoadOptions { eval_split_every: 0, .. } => refuse("data.eval-split-every", "0".into(), "at least 2"),
            LoadOptions { masks: Masks::Object, alpha: Some(alpha), .. } if alpha.is_cover() => {
                let alpha = if *alpha == Alpha::Keyed { "keyed" } else { "composite" };
                refuse("data.alpha", alpha.into(), "`mask` where `data.masks` is `object`, or leave it out")
            }
            LoadOptions { random_points: 0, .. } => refuse("data.random-points", "0".into(), "at least 1"),
            LoadOptions { images: Some(folder), .. } if super::names::clean_folder(folder).is_none() => refuse(
                "data.images",
                folder.clone(),
                "the name of a folder inside the scene folder, or `.` for the scene folder itself",
            ),
            _ => Ok(()),
        }
    }

    /// Size of a photo after `resolution` and `max_resolution`. `prescaled` photos come from a folder such as
    /// `images_4` and have been divided already.
    pub(crate) fn target_size(&self, width: u32, height: u32, prescaled: bool) -> (u32, u32) {
        let scale_to = |(w, h): (u32, u32), scale: f64| {
            // Ties go to the even number, as in the published code.
            let scaled = |side: u32| ((f64::from(side) * scale).round_ties_even() as u32).max(1);
            (scaled(w), scaled(h))
        };
        let mut size = (width, height);
        let target = match self.resolution {
            Resolution::Factor(factor) => {
                if !prescaled {
                    size = scale_to(size, 1.0 / f64::from(factor));
                }
                width
            }
            Resolution::Width(target) => target,
            Resolution::PublishedCap => PUBLISHED_WIDTH_CAP,
        };
        if target < width {
            size = scale_to(size, f64::from(target) / f64::from(width));
        }
        let longer = size.0.max(size.1);
        match self.max_resolution {
            Some(cap) if cap < longer => scale_to(size, f64::from(cap) / f64::from(longer)),
            _ => size,
        }
    }
}
