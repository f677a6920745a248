//! How a scene is loaded: photo size, photo folder, split, principal point.

use super::DatasetError;
use crate::memory::MemoryBudget;
use crate::words::display_words;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

/// Photo size to train at, in the numbers of the published command line: 1, 2, 4, 8 divide, a larger number is
/// the width in pixels, -1 caps the width at 1600.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
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

impl FromStr for Resolution {
    type Err = DatasetError;

    fn from_str(text: &str) -> Result<Self, DatasetError> {
        match text.trim().parse::<i64>().map(|number| (number, u32::try_from(number))) {
            Ok((-1, _)) => Ok(Resolution::PublishedCap),
            Ok((_, Ok(factor @ (1 | 2 | 4 | 8)))) => Ok(Resolution::Factor(factor)),
            Ok((_, Ok(width))) if width > 8 => Ok(Resolution::Width(width)),
            _ => Err(resolution_error(text)),
        }
    }
}

crate::text_in_files!(Resolution);

impl fmt::Display for Resolution {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Resolution::Factor(number) | Resolution::Width(number) => number.fmt(f),
            Resolution::PublishedCap => f.write_str("-1"),
        }
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

/// What the values of a photo mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ColorSpace {
    /// They are taken as they are.
    Srgb,
    /// Linear light: converted to sRGB before they become 8 bits.
    Linear,
}

display_words!(PrincipalPoint, Resampler);

/// How a scene is loaded.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct LoadOptions {
    /// Factor 1, 2, 4 or 8 to divide the photos by, a target width in pixels, or -1 to cap the width at 1600.
    pub resolution: Resolution,
    /// How photos are made smaller: `lanczos3`, or `bicubic` as in the published code.
    pub resampler: Resampler,
    /// Photo folder inside the scene, `.` for the scene folder itself; unset: found by the loader.
    pub images: Option<String>,
    /// Longest side that a photo may have, in pixels, after `resolution`; unset: no limit.
    pub max_resolution: Option<u32>,
    /// Whether to hold out test views.
    pub eval: bool,
    /// With `eval`: hold out every Nth photo (by name, from the first) as a test view (published: 8).
    pub eval_split_every: u32,
    /// A file with the names of training and held-out photos, such as those of `ibgs split`, in place of the scene's own
    /// `split.json`. Photos that it does not name are not loaded, nor points that none of its training photos shows.
    pub split: Option<PathBuf>,
    /// `true`: the principal point that the scene gives; `centred`: the image centre.
    pub principal_point: PrincipalPoint,
    /// What lies outside the masks (files in `masks/` or alpha channels): `ignore`: anything; `object`: nothing. Unset: `object`
    /// where those of all photos leave one object and drop what surrounds it (and `alpha` is unset), else `ignore`.
    pub masks: Option<Masks>,
    /// What the photos' alpha means: `mask`; `composite`: they lie over the background; `keyed`: they have none and lie on one
    /// colour. Unset: `composite` in Blender scenes with alpha, `keyed` where all photos lie on one colour, else `mask`, and
    /// always with `masks = "object"`.
    pub alpha: Option<Alpha>,
    /// What the photos' values mean: `srgb`, or `linear` light; unset: `linear` in EXR files, `srgb` in others.
    pub color_space: Option<ColorSpace>,
    /// Leave out points of a COLMAP model with a reprojection error over 2 pixels or fewer than 3 images (method.md section
    /// 10.9).
    pub filter_points: bool,
    /// Extent of the cameras in scene units, by which near plane, learning rates and other lengths are measured; unset: for
    /// learning rates and densification 1.1 times the distance of the farthest training camera from their mean, for lengths in
    /// local units that of the nearest nine tenths of all cameras from their median. `ibgs merge` takes that of a block.
    pub extent: Option<f64>,
    /// What the training begins with: `auto`: the scene's points and those found in the photos (not where the photos show an
    /// object, nor on a software adapter, where the scene has points); `scene`: its own alone; `photos`: those found in the
    /// photos alone, also where the scene has none; `random`.
    pub initial_points: InitialPoints,
    /// Number of points that are made; in the hull of an object at most 150 for each photo.
    pub random_points: u32,
    /// Memory of the host for decoded photos: `auto` (half of what is free), `none` (no limit: all are kept), or a size such as
    /// `8GiB`. Beyond it those used longest ago are decoded again when they are needed.
    pub host_memory: MemoryBudget,
    /// Seed of the random points.
    #[serde(skip)]
    pub seed: u64,
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
            masks: None,
            alpha: None,
            color_space: None,
            filter_points: false,
            extent: None,
            initial_points: InitialPoints::Auto,
            random_points: 100_000,
            host_memory: MemoryBudget::Auto,
            seed: 0,
        }
    }
}

impl LoadOptions {
    /// What lies outside of the masks; [`load`](super::load) finds out where it is not given.
    pub fn masks(&self) -> Masks {
        self.masks.unwrap_or_default()
    }

    /// Whether the photos show an object with nothing around it.
    pub fn shows_object(&self) -> bool {
        self.masks() == Masks::Object || self.alpha.is_some_and(Alpha::is_cover)
    }

    /// Whether the photos' alpha says how much of each pixel an object covers.
    pub fn has_alpha(&self) -> bool {
        self.alpha == Some(Alpha::Composite)
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
            LoadOptions { masks: Some(Masks::Object), alpha: Some(alpha), .. } if alpha.is_cover() => {
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

    /// The width that is asked for, where photos of this width are narrower and keep their size.
    pub(crate) fn missed_width(&self, width: u32) -> Option<u32> {
        match self.resolution {
            Resolution::Width(target) if target > width => Some(target),
            _ => None,
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
