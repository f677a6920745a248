//! Checkpoints: everything that a training resumes from. [`Checkpoint::write`] describes the file.

mod file;

use super::optim::{Moments, moment_names, moment_words};
use super::refining::RefinementState;
use super::telemetry::{RecorderState, Telemetry};
use super::transients::Masking;
use ibgs_core::config::{AdamMoments, TrainConfig};
use ibgs_core::exposure::{Exposure, ExposureState};
use ibgs_core::files::WriteError;
use ibgs_core::local_space::LocalSpace;
use ibgs_core::residual::layers::WEIGHTS;
use ibgs_core::scene::{Gaussians, PerGaussian};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io;
use std::path::PathBuf;
use thiserror::Error;

/// The version that writes checkpoints; those of other versions are not read.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Version of the layout.
pub const FORMAT: u32 = 10;

/// Why a training cannot resume from a checkpoint, or none can be written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CheckpointError {
    /// The file cannot be opened.
    #[error("cannot read the checkpoint {}: {source}; check the path", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// The file is something else, or a part of it is missing or broken.
    #[error("the checkpoint {} is damaged: {reason}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// Another version of the program wrote it.
    #[error("the checkpoint {} is of ibgs {found}, not of {} (format {})", path.display(), VERSION, FORMAT)]
    Version {
        /// The file.
        path: PathBuf,
        /// What wrote it.
        found: String,
    },
    /// The scene is not the one it was trained on.
    #[error(
        "the checkpoint belongs to another scene: cameras, names or photos differ from those it was trained on; give the same \
         scene and load it with the same options"
    )]
    OtherScene,
    /// Its parts do not fit each other.
    #[error("the checkpoint contradicts itself: {0}")]
    Nonsense(&'static str),
    /// Writing failed.
    #[error(transparent)]
    Write(#[from] WriteError),
}

/// The residual network with the moments of its optimiser, a value a weight.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NetworkState {
    /// Flat weights.
    pub weights: Vec<f32>,
    /// First and second moments.
    pub moments: [Vec<f32>; 2],
    /// Steps taken.
    pub steps: i32,
}

/// The small things of a training.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TrainingState {
    pub iteration: u32,
    pub space: LocalSpace,
    pub sh_degree: u32,
    pub gaussians: usize,
    /// Steps of the base's and the planes' optimiser.
    pub steps: [i32; 2],
    /// Steps of the network's; none without a network.
    pub network_steps: Option<i32>,
    /// Views still to come in this epoch.
    pub queue: Vec<usize>,
    pub rng: ChaCha8Rng,
    pub extent: f64,
    pub prune_length: f64,
    pub has_planes: bool,
    pub overflowed: bool,
    /// Tile intersections that there is room for.
    pub room: u64,
    /// Part of the learning rates that counts.
    pub caution: f64,
    pub exposure: Option<Vec<ExposureState>>,
    pub poses: Option<RefinementState>,
    /// Numbers of what is known of what moves; none where no masks are learned.
    pub transients: Option<usize>,
    /// Training views with their pixels, whose depth maps are here.
    pub depths: BTreeMap<usize, usize>,
    pub telemetry: Telemetry,
    pub recorder: RecorderState,
}

/// Everything that a training resumes from, on the host.
#[derive(Clone, Debug)]
pub struct Checkpoint {
    /// The options.
    pub config: TrainConfig,
    /// Checksum of the scene, see [`Dataset::checksum`](ibgs_core::dataset::Dataset::checksum).
    pub scene: u32,
    /// The model.
    pub gaussians: Gaussians,
    /// The residual network; none without one.
    pub network: Option<NetworkState>,
    /// The further members of an ensemble.
    pub members: Vec<Self>,
    /// What the program keeps besides: times, curves, measurements.
    pub run: serde_json::Value,
    /// Moments of the parameters that are trained.
    pub(super) moments: Moments,
    /// Four values a Gaussian.
    pub(super) statistics: Vec<f32>,
    /// Median depths of the training views when they were last trained; only with `deterministic`. Other runs render
    /// them again from the model, with slightly different values.
    pub(super) depths: BTreeMap<usize, Vec<f32>>,
    /// What is known of what moves in the training photos, and their masks.
    pub(super) transients: Option<Vec<f32>>,
    pub(super) state: TrainingState,
}

impl Checkpoint {
    /// Iterations done.
    pub fn iteration(&self) -> u32 {
        self.state.iteration
    }

    /// The training photos' exposures; none where they are not corrected.
    pub fn exposures(&self) -> Option<Vec<Exposure>> {
        self.state.exposure.as_ref().map(|states| states.iter().map(|state| state.exposure).collect())
    }

    /// Whether every number of the model and its optimiser is finite.
    pub fn is_finite(&self) -> bool {
        self.state.exposure.iter().flatten().all(ExposureState::is_finite)
            && self.state.poses.iter().all(RefinementState::is_finite)
            && self.tensors().iter().all(|(_, values)| values.iter().all(|v| v.is_finite()))
            && self.moments().iter().all(|(_, words)| self.are_finite(words))
            && self.members.iter().all(Self::is_finite)
    }

    /// Whether these words of moments are; those that are packed always are.
    fn are_finite(&self, words: &[u32]) -> bool {
        self.config.adam.moments == AdamMoments::Packed || words.iter().all(|&word| f32::from_bits(word).is_finite())
    }

    /// The words of the Gaussians' moments by name.
    fn moments(&self) -> Vec<(String, &[u32])> {
        let names = moment_names(self.config.adam.moments);
        let each = PerGaussian::KEYS.zip(self.moments.as_ref()).into_array().into_iter();
        let named = each.flat_map(|(name, moments)| names.iter().zip(moments.iter().flatten()).map(move |m| (name, m)));
        named.map(|(name, (which, words))| (format!("{name}.{which}"), &words[..])).collect()
    }

    /// All other tensors by name.
    fn tensors(&self) -> Vec<(String, &[f32])> {
        let named = PerGaussian::KEYS.zip(self.gaussians.values()).into_array();
        let mut all: Vec<(String, &[f32])> = named.map(|(name, values)| (name.to_owned(), values)).into();
        all.push(("statistics".to_owned(), &self.statistics[..]));
        if let Some(NetworkState { weights, moments: [first, second], .. }) = &self.network {
            all.extend(
                [("network", weights), ("network.first", first), ("network.second", second)]
                    .map(|(name, values)| (name.to_owned(), &values[..])),
            );
        }
        all.extend(self.transients.iter().map(|values| ("transients".to_owned(), &values[..])));
        all.extend(self.depths.iter().map(|(view, depth)| (format!("depth.{view}"), &depth[..])));
        all
    }

    /// From the small values, and a reader of tensors by name and number of values.
    fn assemble<E>(
        (config, scene, run, state): (TrainConfig, u32, serde_json::Value, TrainingState),
        mut tensor: impl FnMut(&str, usize) -> Result<Vec<f32>, E>,
    ) -> Result<Self, E> {
        let n = state.gaussians;
        let rows = PerGaussian::rows((state.sh_degree as usize + 1).pow(2));
        let sized = PerGaussian::KEYS.zip(rows);
        let values = sized.try_map(|(name, row)| tensor(name, row * n))?;
        let trained = PerGaussian::with_gradients(state.network_steps.is_some());
        let form = config.adam.moments;
        let moments = sized.zip(trained).try_map(|((name, row), is_trained)| {
            let mut moment = |which: &&str| {
                let words = tensor(&format!("{name}.{which}"), n * moment_words(form, row))?;
                Ok(words.into_iter().map(f32::to_bits).collect())
            };
            is_trained.then(|| moment_names(form).iter().map(&mut moment).collect()).transpose()
        })?;
        let network = match state.network_steps {
            None => None,
            Some(steps) => Some(NetworkState {
                weights: tensor("network", WEIGHTS)?,
                moments: [tensor("network.first", WEIGHTS)?, tensor("network.second", WEIGHTS)?],
                steps,
            }),
        };
        let mut depths = BTreeMap::new();
        for (&view, &pixels) in &state.depths {
            depths.insert(view, tensor(&format!("depth.{view}"), pixels)?);
        }
        let statistics = tensor("statistics", 4 * n)?;
        let transients = state.transients.map(|count| tensor("transients", count)).transpose()?;
        let gaussians = Gaussians::from_values(state.space, state.sh_degree, values);
        let members = Vec::new();
        Ok(Self { config, scene, gaussians, network, members, run, moments, statistics, depths, transients, state })
    }

    /// Whether a training on this scene, in this space, with views of these widths and heights, can resume from it.
    pub(super) fn check(&self, (scene, space): (u32, LocalSpace), sizes: &[[u32; 2]]) -> Result<(), CheckpointError> {
        let views = sizes.len();
        let state = &self.state;
        let require = |holds: bool, what| if holds { Ok(()) } else { Err(CheckpointError::Nonsense(what)) };
        if self.scene != scene || self.gaussians.space != space {
            return Err(CheckpointError::OtherScene);
        }
        require(state.gaussians > 0, "it has no Gaussian")?;
        require(state.iteration <= self.config.iterations(), "it is of an iteration beyond the last one")?;
        let steps = state.steps.into_iter().chain(state.network_steps);
        let steps = steps.chain(state.exposure.iter().flatten().map(|exposure| exposure.steps));
        let possible = |steps: i32| u32::try_from(steps).is_ok_and(|steps| steps <= state.iteration);
        require(steps.into_iter().all(possible), "it took more steps than iterations")?;
        require(state.queue.iter().all(|&view| view < views), "the order of its views names one that is not there")?;
        let pixels = |size: &[u32; 2]| size[0] as usize * size[1] as usize;
        let fits = |(view, depth): (&usize, &Vec<f32>)| sizes.get(*view).map(pixels) == Some(depth.len());
        require(self.depths.iter().all(fits), "a depth map does not fit its view")?;
        let exposures = state.exposure.as_ref().is_none_or(|states| states.len() == views);
        require(exposures, "the number of exposures is not that of the views")?;
        let poses = state.poses.as_ref().is_none_or(|state| state.is_sound(views));
        require(poses, "its cameras are not those of the views")?;
        let transients = state.transients.is_none_or(|count| count == Masking::numbers(sizes));
        require(transients, "what moves is not that of the views' cells")?;
        require(state.recorder.is_sound(state.iteration), "its telemetry has a wrong length")?;
        let lengths = [state.extent, state.prune_length, state.caution];
        require(lengths.iter().all(|v| v.is_finite() && *v > 0.0), "its scene extent is not positive")?;
        require(
            self.members.len() + 1 == self.config.ensemble() as usize,
            "the number of its members is not that of the options",
        )?;
        self.members.iter().try_for_each(|member| member.check((scene, space), sizes))?;
        require(self.is_finite(), "a number is not finite")
    }
}
