//! The results files of a model folder, read back.

use super::log::TrainingLog;
use super::results::{Protocol, Scored};
use super::{OutputError, OutputFolder, read_object};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::io;

/// File of speed, memory and storage.
pub const SPEED_FILE: &str = "result_fps_mem.json";
/// File of the scores of the mesh.
pub const MESH_FILE: &str = "results_mesh.json";
/// File of the training's time.
pub const TIME_FILE: &str = "result_training.json";
/// File of the training's curves.
pub const LOG_FILE: &str = "training_log.json";

/// Mean scores over the held-out views.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
pub struct Means {
    /// Mean PSNR in dB; none where it is infinite.
    pub psnr: Option<f64>,
    /// The same after an affine map of the colours.
    #[serde(default, rename = "PSNR_aligned")]
    pub aligned_psnr: Option<f64>,
    /// Mean SSIM.
    pub ssim: Option<f64>,
    /// Mean LPIPS, where it was computed.
    pub lpips: Option<f64>,
    /// What they depend on; other programs leave it out.
    #[serde(default, rename = "protocol")]
    pub protocol: Option<Protocol>,
}

/// Scores by the name of a view.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(rename_all = "UPPERCASE", default)]
pub struct ByView {
    /// PSNR in dB.
    pub psnr: BTreeMap<String, Option<f64>>,
    /// SSIM.
    pub ssim: BTreeMap<String, Option<f64>>,
    /// LPIPS.
    pub lpips: BTreeMap<String, Option<f64>>,
}

/// Bytes on the disk; none for a file that was not found.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(default)]
pub struct Storage {
    /// The point cloud.
    pub gaussians: Option<u64>,
    /// The residual network.
    pub network: Option<u64>,
    /// The cameras.
    pub poses: Option<u64>,
    /// The training photos.
    pub photos: Option<u64>,
    /// The one-file bundle, in place of all of these.
    pub bundle: Option<u64>,
}

impl Storage {
    /// Bytes of everything; none where nothing is known.
    pub fn total(&self) -> Option<u64> {
        let parts = [self.gaussians, self.network, self.poses, self.photos];
        self.bundle.or_else(|| {
            parts
                .iter()
                .any(Option::is_some)
                .then(|| parts.iter().flatten().fold(0, |sum: u64, part| sum.saturating_add(*part)))
        })
    }
}

/// Speed, memory and storage of a model.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub struct Speed {
    /// Frames a second with kept depth maps.
    #[serde(rename = "FPS_warm")]
    pub fps_warm: Option<f64>,
    /// Frames a second with depth maps made for every frame, as published; none of a model without a residual.
    #[serde(rename = "FPS_cold")]
    pub fps_cold: Option<f64>,
    /// Number of Gaussians.
    pub gaussians: Option<u64>,
    /// Bytes on the disk.
    pub storage_bytes: Storage,
    /// Bytes of device memory.
    pub memory_reserved_bytes: Option<u64>,
    /// The adapter.
    pub device: String,
}

/// One stage of a training.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub struct Stage {
    /// Its iterations.
    pub iterations: u32,
    /// Its time.
    pub seconds: f64,
    /// Most device memory.
    pub peak_reserved_bytes: Option<u64>,
}

/// Time of a training.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub struct Time {
    /// Seconds spent in iterations.
    pub seconds: Option<f64>,
    /// Iterations.
    pub iterations: Option<u32>,
    /// Stages by name.
    pub stages: BTreeMap<String, Stage>,
    /// The adapter.
    pub device: String,
    /// The command lines that started and resumed it; empty where they were not recorded.
    pub commands: Vec<String>,
}

/// F1 of a mesh at a threshold.
#[derive(Clone, Copy, Debug, Deserialize)]
pub struct FScore {
    /// Distance that counts as near.
    pub threshold: f64,
    /// F1.
    pub f1: f64,
}

/// Distances between a mesh and the true surface.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(default)]
pub struct Distances {
    /// Chamfer distance; none where one of them has no point.
    pub chamfer: Option<f64>,
}

/// Scores of a mesh.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub struct MeshScores {
    /// By threshold.
    pub f_scores: Vec<FScore>,
    /// Distances.
    pub chamfer: Distances,
}

/// Scores of one image, base or final.
#[derive(Clone, Debug, Default)]
pub struct Scores {
    /// Means over the views.
    pub means: Means,
    /// Single views.
    pub views: ByView,
}

/// All that is known of a model at an iteration.
#[derive(Clone, Debug, Default)]
pub struct Figures {
    /// The iteration.
    pub iteration: u32,
    /// Scores of the base image.
    pub base: Option<Scores>,
    /// Scores of the final image.
    pub image: Option<Scores>,
    /// Speed, memory and storage.
    pub speed: Option<Speed>,
    /// Time of the training that ended there.
    pub time: Option<Time>,
    /// Scores of the mesh.
    pub mesh: Option<MeshScores>,
    /// (iteration, mean PSNR in dB) of every measurement of the base image.
    pub base_psnr: Vec<[f64; 2]>,
    /// The same of the final image.
    pub image_psnr: Vec<[f64; 2]>,
    /// Curves of the training.
    pub log: TrainingLog,
}

impl Figures {
    /// Reads what a model folder says of an iteration; files that are not there give none.
    ///
    /// # Errors
    /// [`OutputError::Damaged`] naming the file and what is wrong in it, [`OutputError::Read`].
    pub fn read(folder: &OutputFolder, iteration: u32) -> Result<Self, OutputError> {
        let scores = |scored: Scored| -> Result<_, OutputError> {
            let [summary, per_view] = scored.files();
            let Some(means) = entry(folder, summary, iteration)? else { return Ok(None) };
            Ok(Some(Scores { means, views: entry(folder, per_view, iteration)?.unwrap_or_default() }))
        };
        Ok(Self {
            iteration,
            base: scores(Scored::Base)?,
            image: scores(Scored::Final)?,
            speed: entry(folder, SPEED_FILE, iteration)?,
            time: entry(folder, TIME_FILE, iteration)?,
            mesh: entry(folder, MESH_FILE, iteration)?,
            base_psnr: over_iterations(folder, Scored::Base)?,
            image_psnr: over_iterations(folder, Scored::Final)?,
            log: folder.read_log()?,
        })
    }

    /// What the scores depend on, as far as it was written.
    pub fn protocol(&self) -> Option<&Protocol> {
        self.image.iter().chain(&self.base).find_map(|scores| scores.means.protocol.as_ref())
    }
}

/// What a results file says of an iteration.
fn entry<T: DeserializeOwned>(folder: &OutputFolder, file: &str, iteration: u32) -> Result<Option<T>, OutputError> {
    let path = folder.root().join(file);
    let key = format!("ours_{iteration}");
    let value = read_object(&path)?.remove(&key).filter(|value| !value.is_null());
    let parse = |value: Value| {
        let reason = |e: serde_json::Error| OutputError::Damaged { path, reason: format!("in `{key}`: {e}") };
        serde_json::from_value(value).map_err(reason)
    };
    value.map(parse).transpose()
}

/// Mean PSNR at every iteration that was measured.
fn over_iterations(folder: &OutputFolder, scored: Scored) -> Result<Vec<[f64; 2]>, OutputError> {
    let object = read_object(&folder.root().join(scored.files()[0]))?;
    let point = |(key, value): (&String, &Value)| {
        let iteration: u32 = key.strip_prefix("ours_")?.parse().ok()?;
        Some([f64::from(iteration), value.get("PSNR")?.as_f64()?])
    };
    let mut points: Vec<[f64; 2]> = object.iter().filter_map(point).collect();
    points.sort_by(|a, b| a[0].total_cmp(&b[0]));
    Ok(points)
}

impl OutputFolder {
    /// Writes the curves of the training.
    ///
    /// # Errors
    /// [`OutputError::Write`].
    pub fn write_log(&self, log: &TrainingLog) -> Result<(), OutputError> {
        let text = serde_json::to_string(log).map_err(io::Error::from);
        let write = |out: &mut dyn io::Write| out.write_all(text?.as_bytes());
        Ok(crate::files::write_atomically(&self.root().join(LOG_FILE), write)?)
    }

    /// Reads the curves of the training; empty where there are none.
    ///
    /// # Errors
    /// [`OutputError::Damaged`], [`OutputError::Read`].
    pub fn read_log(&self) -> Result<TrainingLog, OutputError> {
        let path = self.root().join(LOG_FILE);
        match fs::read_to_string(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(TrainingLog::default()),
            Err(source) => Err(OutputError::Read { path, source }),
            Ok(text) => serde_json::from_str(&text).map_err(|e| OutputError::Damaged { path, reason: e.to_string() }),
        }
    }
}
