//! Options of the photos: where they come from and how they are prepared.

use super::{TrainConfig, text};
use crate::dataset::{Alpha, ColorSpace, InitialPoints, LoadOptions, Masks, PrincipalPoint, Resampler, Resolution};
use crate::sources::memory::MemoryBudget;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Where the photos come from and how they are prepared.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct DataConfig {
    /// Scene folder or a ZIP archive of one; unset: the built-in demo scene.
    pub source: Option<PathBuf>,
    /// Factor 1, 2, 4 or 8 to divide the photos by, a target width in pixels, or -1 to cap the width at 1600.
    #[serde(with = "text")]
    pub resolution: Resolution,
    /// How photos are made smaller: `lanczos3`, or `bicubic` as in the published code.
    #[serde(with = "text")]
    pub resampler: Resampler,
    /// Photo folder inside the scene; unset: found by the loader.
    pub images: Option<String>,
    /// Longest side that a photo may have, in pixels; unset: no limit.
    pub max_resolution: Option<u32>,
    /// Whether to hold out test views.
    pub eval: bool,
    /// Hold out every Nth photo (by name, from the first) as a test view.
    pub eval_split_every: u32,
    /// A file with the names of training and held-out photos, such as those of `ibgs split`, in place of the scene's own
    /// `split.json`. Photos that it does not name are not loaded, nor points that none of its training photos shows.
    pub split: Option<PathBuf>,
    /// `true`: the principal point that the scene gives; `centred`: the image centre.
    #[serde(with = "text")]
    pub principal_point: PrincipalPoint,
    /// What lies outside the masks (files in `masks/` or alpha channels): `ignore`: anything; `object`: nothing.
    pub masks: Masks,
    /// What the photos' alpha means: `mask`; `composite`: they lie over the background; `keyed`: they have none and lie on one
    /// colour. Unset: `composite` in Blender scenes, `keyed` where all photos lie on one colour, else `mask`.
    pub alpha: Option<Alpha>,
    /// What the photos' values mean: `srgb`, or `linear` light; unset: `linear` in EXR files, `srgb` in others.
    pub color_space: Option<ColorSpace>,
    /// Leave out points of a COLMAP model with a reprojection error over 2 pixels or fewer than 3 images.
    pub filter_points: bool,
    /// Extent of the cameras in scene units, by which near plane, learning rates and other lengths are measured; unset: 1.1
    /// times the distance of the farthest cameras from the middle. `ibgs merge` takes that of a block.
    pub extent: Option<f64>,
    /// What the training begins with: `auto`: the scene's points and those found in the photos (not on a software adapter where
    /// the scene has points); `scene`: its own alone; `photos`: those found in the photos alone, also where the scene has none;
    /// `random`.
    pub initial_points: InitialPoints,
    /// Number of points that are made; in the hull of an object at most 150 for each photo.
    pub random_points: u32,
    /// Memory of the host for decoded photos: `auto` (half of what is free), `none` (no limit: all are kept), or a size such as
    /// `8GiB`. Beyond it those used longest ago are decoded again when they are needed.
    pub host_memory: MemoryBudget,
    /// Gives every photo of the demo scene another exposure, by this seed; unset: the same for all.
    pub demo_exposure_seed: Option<u64>,
}

impl TrainConfig {
    /// How its scene is loaded.
    pub fn load_options(&self) -> LoadOptions {
        let data = &self.data;
        LoadOptions {
            resolution: data.resolution,
            resampler: data.resampler,
            images: data.images.clone(),
            max_resolution: data.max_resolution,
            eval: data.eval,
            eval_split_every: data.eval_split_every as usize,
            split: data.split.clone(),
            principal_point: data.principal_point,
            masks: data.masks,
            alpha: data.alpha,
            color_space: data.color_space,
            filter_points: data.filter_points,
            extent: data.extent,
            initial_points: data.initial_points,
            seed: self.seed,
            random_points: data.random_points as usize,
            host_memory: data.host_memory.host_bytes(),
        }
    }
}
