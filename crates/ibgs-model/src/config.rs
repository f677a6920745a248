//! The options of a training run: every constant of method.md, with its reference default.
//!
//! Written to `config.toml` of the output folder and read back from there. A milestone that is left out
//! follows the number of iterations (see [`Schedule`](schedule::Schedule)).

mod adapt;
mod background;
mod check;
mod defaults;
mod difference;
mod error;
mod image;
mod preset;
pub mod schedule;
mod stages;
mod text;

pub use crate::sources::find::SourceOptions;
pub use background::Background;
pub use difference::OptionDifference;
pub use error::ConfigError;
pub use preset::Preset;
pub use stages::{ExposureConfig, ExposureSwitch, Learners, ResidualConfig, SurfaceConfig};

use crate::dataset::{Alpha, ColorSpace, InitialPoints, LoadOptions, Masks, PrincipalPoint, Resampler, Resolution};
use crate::files::{self, TomlError};
use crate::sources::memory::MemoryBudget;
use serde::{Deserialize, Serialize};
use std::io;
use std::path::{Path, PathBuf};

/// What is trained.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Method {
    /// Image-based Gaussian splatting: the base colour and a residual from the photos of neighbouring views.
    #[default]
    #[serde(rename = "ibgs")]
    Ibgs,
    /// Plain 3D Gaussian splatting: the base colour alone (method.md section 2).
    #[serde(rename = "3dgs")]
    Gs3,
}

/// All options of a training run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct TrainConfig {
    /// What is trained.
    pub method: Method,
    /// Number of iterations, counted from 1; unset: by the photos, see [`TrainConfig::adapt_to_photos`].
    pub iterations: Option<u32>,
    /// Milestones follow `iterations / 30000`; otherwise they keep their absolute values.
    pub schedule_scaling: bool,
    /// PLY file of this scene to start from; it is neither densified nor reset; unset: the scene's points.
    pub init: Option<PathBuf>,
    /// Seed of view order and sampling.
    pub seed: u64,
    /// The run repeats bit for bit on the same adapter and build, even when it is resumed: it computes in float32 only,
    /// and checkpoints hold the depth maps of the training views.
    pub deterministic: bool,
    /// Degree of the spherical harmonics, 0 to 3; unset: 2, with `method = "3dgs"` 3.
    pub sh_degree: Option<u32>,
    /// Iterations between two degrees; unset: 1000, scaled.
    pub sh_interval: Option<u32>,
    /// The colour behind the Gaussians: `white`, `black`, `R,G,B`, or `random`; unset: black, and white where the scene is a
    /// Blender one with transparent photos.
    #[serde(alias = "white-background")]
    pub background: Option<Background>,
    /// Weight of 1 - SSIM in the image loss; L1 has the rest.
    pub ssim_weight: f64,
    /// Opacity of the first Gaussians; unset: 0.1, with MCMC 0.5.
    pub initial_opacity: Option<f64>,
    /// Scale of the first Gaussians, times the distance of their neighbours; unset: 1, with MCMC 0.1.
    pub initial_scale: Option<f64>,
    /// Evaluate every N iterations; 0: only at `eval-iterations`.
    pub eval_every: u32,
    /// Iterations to evaluate at besides the last; unset: 7000, scaled.
    pub eval_iterations: Option<Vec<u32>>,
    /// Iterations to save the model at besides the last; unset: 7000, scaled.
    pub save_iterations: Option<Vec<u32>>,
    /// Where the photos come from.
    pub data: DataConfig,
    /// Learning rates.
    pub learning_rates: LearningRates,
    /// Size of the 3D smoothing filter in pixels of the nearest training view; 0: none.
    pub filter: f64,
    /// The optimiser.
    pub adam: AdamConfig,
    /// Densification and pruning.
    pub densify: DensifyConfig,
    /// Opacity resets.
    pub opacity_reset: OpacityResetConfig,
    /// Which training views are the sources of a view, and how they are read.
    pub sources: SourceOptions,
    /// Median intersections and surface losses.
    pub surface: SurfaceConfig,
    /// The residual network.
    pub residual: ResidualConfig,
    /// Exposure correction.
    pub exposure: ExposureConfig,
}

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

/// Learning rates (method.md section 1).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct LearningRates {
    /// Factor on the rates of Gaussians and exposures; unset: 1, and less in long runs of the default strategy, as
    /// [`TrainConfig::adapt_to_photos`] chooses.
    pub factor: Option<f64>,
    /// Means at the start, times the scene extent.
    pub mean_initial: f64,
    /// Means at the end, times the scene extent.
    pub mean_final: f64,
    /// Iterations from the first to the last rate of the means; unset: 30000, scaled.
    pub mean_iterations: Option<u32>,
    /// Quaternions.
    pub rotation: f64,
    /// Logarithms of the scales.
    pub scale: f64,
    /// Opacity logits.
    pub opacity: f64,
    /// Constant coefficients of the spherical harmonics.
    pub sh_dc: f64,
    /// The other coefficients have the rate `sh-dc` divided by this.
    pub sh_rest_divisor: f64,
    /// Share of the other coefficients that each iteration removes, times their rate: a surface that few photos show from few
    /// directions keeps a constant colour; unset: 0, with `method = "3dgs"` 1. A departure from method.md.
    pub sh_rest_decay: Option<f64>,
    /// Plane normals.
    pub normal: f64,
    /// Plane offsets have the rate of the means times this.
    pub offset_factor: f64,
}

/// Constants of Adam for the Gaussians (method.md section 1).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct AdamConfig {
    /// Decay of the first moment.
    pub beta1: f64,
    /// Decay of the second moment.
    pub beta2: f64,
    /// Added to the root of the second moment.
    pub epsilon: f64,
}

/// How Gaussians are added and removed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Strategy {
    /// Splits by the largest gradient, pruning and replacement in every round, fading opacities, no resets.
    #[default]
    Default,
    /// By mean gradients of the projected means and, for wide Gaussians, by absolute gradients (method.md section 7).
    Published,
    /// AbsGS (Ye et al., 2024): the absolute gradient alone says what is split.
    AbsGs,
    /// 3D Gaussian splatting as Markov chain Monte Carlo (Kheradmand et al., 2024): moves, noise and a cap.
    Mcmc,
}

/// Densification and pruning (method.md section 7). Lengths are multiples of the scene extent, gradients are by the
/// projected mean in units of half the image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct DensifyConfig {
    /// How Gaussians are added and removed: `default`, `published`, `absgs`, `mcmc`.
    pub strategy: Strategy,
    /// Rounds come after this iteration; unset: 500, scaled only in short runs.
    pub start: Option<u32>,
    /// The number of Gaussians grows before this iteration; unset: 21000, with MCMC 25000, with `published` and `absgs` 15000,
    /// scaled.
    pub end: Option<u32>,
    /// Rounds come at multiples of this; unset: 200, with the other strategies 100, scaled only in short runs.
    pub interval: Option<u32>,
    /// Mean gradient norm from which a Gaussian is cloned or split.
    pub grad_threshold: f64,
    /// Gradients of Gaussians nearer than this view depth, times the extent, count by the square of their depth over it:
    /// it keeps clouds from growing right in front of a camera; 0: all count in full. A departure from method.md.
    pub near_depth: f64,
    /// Largest scale that is cloned, times the extent; larger ones are split.
    pub scale_threshold: f64,
    /// Split by the absolute gradient too.
    pub abs_split: bool,
    /// Mean norm of the absolute gradient from which a Gaussian is split.
    pub abs_grad_threshold: f64,
    /// With AbsGS: mean norm of the absolute gradient from which a large Gaussian is split.
    pub absgs_threshold: f64,
    /// Such a split needs a screen radius above this, in pixels.
    pub abs_min_radius: f64,
    /// Most such splits in one round.
    pub abs_max_per_round: u32,
    /// A split divides the scales by this.
    pub split_divisor: f64,
    /// Gaussians in all; unset: with `default` and `mcmc` by the scene (`choose_cap`), 5 million with the others.
    pub max_splats: Option<u32>,
    /// Gaussians below this opacity are removed.
    pub prune_opacity: f64,
    /// Gaussians with a larger scale, times the extent, are removed after `prune-scale-after`.
    pub prune_scale: f64,
    /// Measure that scale by the median distance of the first Gaussians from the mean camera where that is over three extents:
    /// the extent of a capture that faces forward says nothing about its scene. A departure from method.md.
    pub prune_scale_by_distance: bool,
    /// Pruning by scale begins after this iteration; unset: the interval of the opacity resets.
    pub prune_scale_after: Option<u32>,
    /// Gaussians with a larger screen radius, in pixels, are removed after `prune-scale-after`; 0: never.
    pub prune_screen_radius: f64,
    /// What only the strategy `default` uses.
    pub growth: GrowthConfig,
    /// What only the strategy `mcmc` uses.
    pub mcmc: McmcConfig,
}

/// Constants of the strategy `default`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct GrowthConfig {
    /// Largest norm of the absolute gradient over the views, in units of the image, from which a Gaussian may be split.
    pub threshold: f64,
    /// Share of those that is split in a round.
    pub fraction: f64,
    /// Pixels with an error above their photo's mean that such a Gaussian must have covered in the last ten iterations before the
    /// round, summed over the views; 0: errors are ignored. 60 halves the number of Gaussians.
    pub error_pixels: f64,
    /// Gaussians below this opacity are removed.
    pub prune_opacity: f64,
    /// What every opacity loses in a round, times the part of the run that is left.
    pub opacity_decay: f64,
    /// Gaussians with a larger radius, in units of the image's longer side, are always split; 0: none are.
    pub screen_size: f64,
    /// Gaussians nearer to a training camera than this part of the median depth of the points in its image are removed, except
    /// where points are as near; 0: none are.
    pub free_space: f64,
}

/// Constants of the strategy `mcmc`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct McmcConfig {
    /// Noise of the means, times their learning rate.
    pub noise: f64,
    /// Weight of the mean opacity in the loss.
    pub opacity_weight: f64,
    /// Weight of the mean scale in the loss.
    pub scale_weight: f64,
    /// Gaussians up to this opacity are moved elsewhere.
    pub dead_opacity: f64,
    /// Factor by which the number of Gaussians grows in a round; unset: the one that reaches the cap by half of the
    /// run, at least 1.05.
    pub growth: Option<f64>,
}

impl DensifyConfig {
    /// Gaussians in all.
    pub fn most(&self) -> u32 {
        self.max_splats.unwrap_or(if self.strategy == Strategy::Mcmc { 1_000_000 } else { 5_000_000 })
    }
}

/// Opacity resets (method.md section 7).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct OpacityResetConfig {
    /// Resets come at multiples of this, before densification ends; unset: 3000, scaled.
    pub interval: Option<u32>,
    /// Opacity is clamped to at most this.
    pub max_opacity: f64,
}

/// Iterations of a run that starts from a finished model.
const WARM_ITERATIONS: u32 = 3_000;
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

    /// Colour behind the Gaussians in rendered views.
    pub fn background(&self) -> [f32; 3] {
        self.background.unwrap_or(Background::BLACK).shown().map(|level| f32::from(level) / 255.0)
    }

    /// Whether the photos show an object with nothing around it.
    pub fn shows_object(&self) -> bool {
        self.data.masks == Masks::Object || self.data.alpha.is_some_and(Alpha::is_cover)
    }

    /// Reads options from a TOML file; fields that are left out have their defaults.
    ///
    /// # Errors
    /// [`ConfigError`] naming the file and the line or field.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        let text =
            std::fs::read_to_string(path).map_err(|source| ConfigError::Read { path: path.to_owned(), source })?;
        Self::from_text(&text, path)
    }

    /// Reads options from the text of a TOML file; `path` is for messages.
    ///
    /// # Errors
    /// [`ConfigError`] naming the line or field.
    pub fn from_text(text: &str, path: &Path) -> Result<Self, ConfigError> {
        let config: Self = files::parse_toml(text).map_err(|TomlError { line, reason }| ConfigError::Parse {
            path: path.to_owned(),
            line,
            reason,
        })?;
        config.validate_from(Some(path))?;
        Ok(config)
    }

    /// Writes the options as TOML, in one atomic step.
    ///
    /// # Errors
    /// Those of [`validate`](Self::validate) (nothing is written then) and [`ConfigError::Write`].
    pub fn save(&self, path: &Path) -> Result<(), ConfigError> {
        self.validate()?;
        files::write_atomically(path, |out| out.write_all(self.to_text().map_err(io::Error::other)?.as_bytes()))?;
        Ok(())
    }

    /// The options as TOML.
    ///
    /// # Errors
    /// A value that TOML cannot hold, which [`validate`](Self::validate) refuses.
    pub fn to_text(&self) -> Result<String, toml::ser::Error> {
        let text = toml::to_string_pretty(self)?;
        Ok(format!("# Options of a training run.\n\n{text}\n"))
    }

    /// Checks all values.
    ///
    /// # Errors
    /// [`ConfigError::Invalid`] for the first value that makes no sense.
    pub fn validate(&self) -> Result<(), ConfigError> {
        self.validate_from(None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::residual::variant::NetworkInputs;

    fn load(text: &str) -> Result<TrainConfig, ConfigError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("config.toml");
        std::fs::write(&path, text).unwrap();
        TrainConfig::load(&path)
    }

    #[test]
    fn round_trip() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("config.toml");
        let mut config = TrainConfig::default();
        config.save(&path).unwrap();
        assert_eq!(TrainConfig::load(&path).unwrap(), config);
        config.data.source = Some("a folder/scene".into());
        config.data.images = Some("images_4".to_owned());
        config.data.alpha = Some(Alpha::Composite);
        config.data.masks = Masks::Object;
        config.data.color_space = Some(ColorSpace::Linear);
        config.eval_iterations = Some(vec![1, 2, 300]);
        config.densify.end = Some(1234);
        config.learning_rates.mean_initial = 1.0 / 3.0;
        config.sources.memory = "1.5GiB".parse().unwrap();
        config.sources.max_distance = Some(4.5);
        config.residual.halve_at = Some(vec![]);
        config.residual.inputs = NetworkInputs::DifferencesOnly;
        config.save(&path).unwrap();
        assert_eq!(TrainConfig::load(&path).unwrap(), config);
        assert_eq!(load("").unwrap(), TrainConfig::default());
        let some = "method = \"ibgs\"\n[sources]\ndistances = \"absolute\"\nmax-angle-deg = 50\n[residual]\nfactor = 1";
        assert_eq!(load(some).unwrap().sources.max_angle_deg, 50.0);
    }

    #[test]
    fn options_of_the_photos_are_written_as_they_were_given() {
        for text in ["1", "8", "1008", "-1"] {
            let config = load(&format!("[data]\nresolution = \"{text}\"\nresampler = \"bicubic\"")).unwrap();
            assert_eq!(config.data.resampler, Resampler::Bicubic);
            assert!(config.to_text().unwrap().contains(&format!("resolution = \"{text}\"")), "{text}");
        }
        let text = TrainConfig::default().to_text().unwrap();
        for line in ["resolution = \"1\"", "resampler = \"lanczos3\"", "principal-point = \"true\""] {
            assert!(text.lines().any(|found| found == line), "{line} is not in {text}");
        }
    }

    #[test]
    fn unknown_fields_are_named_with_their_line() {
        let text = load("seed = 3\n\n[densify]\nintervall = 5\n").unwrap_err().to_string();
        assert!(text.contains("config.toml, line 4"), "{text}");
        assert!(text.contains("`intervall`") && !text.contains('\n'), "{text}");
        assert!(load("method = \"4dgs\"").is_err());
        assert!(load("iterations = -1").is_err());
        let text = load("[sources]\nmemory = \"much\"").unwrap_err().to_string();
        assert!(text.contains("line 2") && text.contains("512MiB"), "{text}");
        assert!(load("[residual]\ninputs = \"all\"").unwrap_err().to_string().contains("differences-only"));
        assert!(load("[data]\nmasks = \"thing\"").unwrap_err().to_string().contains("object"));
        assert!(load("iterations = ").is_err());
    }

    #[test]
    fn senseless_values_are_refused_by_name() {
        let cases = [
            ("iterations = 0", "iterations"),
            ("sh-degree = 4", "sh-degree"),
            ("ssim-weight = nan", "ssim-weight"),
            ("initial-scale = 0.0", "initial-scale"),
            ("[densify.mcmc]\ngrowth = 0.5", "densify.mcmc.growth"),
            ("eval-iterations = [0]", "eval-iterations"),
            ("[data]\neval-split-every = 1", "data.eval-split-every"),
            ("[data]\nprincipal-point = \"middle\"", "data.principal-point"),
            ("[data]\nresampler = \"box\"", "data.resampler"),
            ("[data]\nresolution = \"3\"", "data.resolution"),
            ("[learning-rates]\nopacity = -1.0", "learning-rates.opacity"),
            ("[learning-rates]\nmean-final = 0.0", "learning-rates.mean-final"),
            ("[adam]\nbeta2 = 1.0", "adam.beta2"),
            ("[densify]\ninterval = 0", "densify.interval"),
            ("[densify]\nsplit-divisor = inf", "densify.split-divisor"),
            ("[opacity-reset]\nmax-opacity = 1.5", "opacity-reset.max-opacity"),
            ("[sources]\nmax-angle-deg = 0", "sources.max-angle-deg"),
            ("[sources]\nused = 9", "sources.used"),
            ("[sources]\nneighbours = 3", "sources.neighbours"),
            ("[sources]\nvisible = 0", "sources.visible"),
            ("[sources]\nmin-distance = 2.0\nmax-distance = 1.0", "sources.max-distance"),
            ("[surface]\nintersections = 3", "surface.intersections"),
            ("[residual]\nfactor = 0.3", "residual.factor"),
            ("[residual]\nhalve-at = [0]", "residual.halve-at"),
            ("[residual]\nburn-in-gain = -0.5", "residual.burn-in-gain"),
            ("[residual]\ndropout = 1.0", "residual.dropout"),
            ("[exposure]\nlearning-rate = nan", "exposure.learning-rate"),
        ];
        for (text, field) in cases {
            let message = load(text).unwrap_err().to_string();
            assert!(message.contains(&format!("`{field}`")), "{message}");
            assert!(message.contains("config.toml"), "{message}");
        }
        let config = TrainConfig { seed: u64::MAX, ..TrainConfig::default() };
        assert!(config.validate().unwrap_err().to_string().starts_with("option `seed` is"));
    }
}
