//! Checkpoints: everything that a training resumes from. [`Checkpoint::write`] describes the file.

mod file;

use super::telemetry::{RecorderState, Telemetry};
use ibgs_core::config::TrainConfig;
use ibgs_core::exposure::{Exposure, ExposureState};
use ibgs_core::files::WriteError;
use ibgs_core::local_space::LocalSpace;
use ibgs_core::residual::layers::WEIGHTS;
use ibgs_core::scene::Gaussians;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io;
use std::path::PathBuf;
use thiserror::Error;

/// The version that writes checkpoints; those of other versions are not read.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Version of the layout.
pub const FORMAT: u32 = 4;

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
pub(super) struct State {
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
    /// The model, its filters apart.
    pub gaussians: Gaussians,
    /// Sizes of the 3D smoothing filters.
    pub filters: Vec<f32>,
    /// The residual network; none without one.
    pub network: Option<NetworkState>,
    /// What the program keeps besides: times, curves, measurements.
    pub run: serde_json::Value,
    /// First and second moments of the parameters that are trained.
    pub(super) moments: Vec<[Vec<f32>; 2]>,
    /// Four values a Gaussian.
    pub(super) statistics: Vec<f32>,
    /// Median depths of the training views when they were last trained; only with `deterministic`. Other runs render
    /// them again from the model, with slightly different values.
    pub(super) depths: BTreeMap<usize, Vec<f32>>,
    pub(super) state: State,
}

/// Parameters in the order of the optimiser, with values a Gaussian where these are fixed.
const PARAMETERS: [(&str, Option<usize>); 7] = [
    ("means", Some(3)),
    ("rotations", Some(4)),
    ("scales", Some(3)),
    ("opacities", Some(1)),
    ("sh", None),
    ("normals", Some(3)),
    ("offsets", Some(1)),
];

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
            && self.tensors().iter().all(|(_, values)| values.iter().all(|v| v.is_finite()))
    }

    /// All tensors by name.
    fn tensors(&self) -> Vec<(String, &[f32])> {
        let g = &self.gaussians;
        let parameters: [&[f32]; 7] = [
            g.means.as_flattened(),
            g.rotations.as_flattened(),
            g.log_scales.as_flattened(),
            &g.opacity_logits,
            &g.sh,
            g.normals.as_flattened(),
            &g.offsets,
        ];
        let mut all: Vec<(String, &[f32])> =
            PARAMETERS.iter().zip(parameters).map(|((name, _), values)| ((*name).to_owned(), values)).collect();
        for ((name, _), pair) in PARAMETERS.iter().zip(&self.moments) {
            all.extend([(format!("{name}.first"), &pair[0][..]), (format!("{name}.second"), &pair[1][..])]);
        }
        all.extend([("filters", &self.filters), ("statistics", &self.statistics)].map(|(n, v)| (n.to_owned(), &v[..])));
        if let Some(NetworkState { weights, moments: [first, second], .. }) = &self.network {
            all.extend(
                [("network", weights), ("network.first", first), ("network.second", second)]
                    .map(|(name, values)| (name.to_owned(), &values[..])),
            );
        }
        all.extend(self.depths.iter().map(|(view, depth)| (format!("depth.{view}"), &depth[..])));
        all
    }

    /// From the small values, and a reader of tensors by name and number of values.
    fn assemble<E>(
        (config, scene, run, state): (TrainConfig, u32, serde_json::Value, State),
        mut tensor: impl FnMut(&str, usize) -> Result<Vec<f32>, E>,
    ) -> Result<Self, E> {
        let n = state.gaussians;
        let sh = 3 * (state.sh_degree as usize + 1).pow(2);
        let values = PARAMETERS.map(|(_, row)| row.unwrap_or(sh) * n);
        let mut parameters = Vec::new();
        for ((name, _), count) in PARAMETERS.iter().zip(values) {
            parameters.push(tensor(name, count)?);
        }
        let trained = if state.network_steps.is_some() { 7 } else { 5 };
        let mut moments = Vec::new();
        for ((name, _), count) in PARAMETERS.iter().zip(values).take(trained) {
            moments.push([tensor(&format!("{name}.first"), count)?, tensor(&format!("{name}.second"), count)?]);
        }
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
        let (filters, statistics) = (tensor("filters", n)?, tensor("statistics", 4 * n)?);
        let [means, rotations, log_scales, opacity_logits, sh, normals, offsets] =
            parameters.try_into().unwrap_or_else(|_| unreachable!("seven parameters"));
        let gaussians = Gaussians {
            space: state.space,
            means: rows(&means),
            rotations: rows(&rotations),
            log_scales: rows(&log_scales),
            opacity_logits,
            sh,
            sh_degree: state.sh_degree,
            normals: rows(&normals),
            offsets,
        };
        Ok(Self { config, scene, gaussians, filters, network, run, moments, statistics, depths, state })
    }

    /// Whether a training on this scene, in this space, with `pixels` of each view, can resume from it.
    pub(super) fn check(&self, (scene, space): (u32, LocalSpace), pixels: &[usize]) -> Result<(), CheckpointError> {
        let views = pixels.len();
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
        let fits = |(view, depth): (&usize, &Vec<f32>)| pixels.get(*view) == Some(&depth.len());
        require(self.depths.iter().all(fits), "a depth map does not fit its view")?;
        let exposures = state.exposure.as_ref().is_none_or(|states| states.len() == views);
        require(exposures, "the number of exposures is not that of the views")?;
        require(state.recorder.is_sound(state.iteration), "its telemetry has a wrong length")?;
        let lengths = [state.extent, state.prune_length, state.caution];
        require(lengths.iter().all(|v| v.is_finite() && *v > 0.0), "its scene extent is not positive")?;
        require(self.is_finite(), "a number is not finite")
    }
}

fn rows<const C: usize>(values: &[f32]) -> Vec<[f32; C]> {
    values.as_chunks().0.to_vec()
}
