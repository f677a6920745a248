//! A training as the command line or the viewer describes it.

use super::estimate;
use crate::progress::Bars;
use crate::stderr;
use anyhow::{Context, Result, bail};
use ibgs_core::camera::Camera;
use ibgs_core::config::{DataConfig, TrainConfig};
use ibgs_core::dataset::demo::DemoOptions;
use ibgs_core::dataset::{Dataset, shown_by_any};
use ibgs_core::files;
use ibgs_core::gpu::Gpu;
use ibgs_core::model::{load_demo, load_scene};
use ibgs_core::output::{Existing, FolderLock, OutputFolder};
use ibgs_core::raster::Rasterizer;
use ibgs_core::residual::weights;
use ibgs_core::scene::read_gaussians;
use ibgs_core::sources::memory::MemoryBudget;
use ibgs_train::checkpoint::Checkpoint;
use ibgs_train::{Session, Trainer};
use ibgs_viewer::TrainingWish;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The demo scene's own defaults.
pub struct DemoDefaults {
    /// Number of iterations.
    pub iterations: u32,
    /// Largest number of Gaussians.
    pub max_splats: u32,
    /// Size of the residual network's images, relative to the photos.
    pub residual_factor: f64,
}

impl DemoDefaults {
    /// On a software adapter.
    pub const SOFTWARE: Self = Self { iterations: 200, max_splats: 12_000, residual_factor: 0.5 };
    /// On a GPU.
    pub const GPU: Self = Self { iterations: 10_000, max_splats: 1_000_000, residual_factor: 1.0 };

    /// Those of an adapter.
    pub fn of(gpu: &Gpu) -> Self {
        if gpu.is_software() { Self::SOFTWARE } else { Self::GPU }
    }

    /// Sets them where no option is given. A run from a finished model is no longer than usual.
    pub fn fill(&self, config: &mut TrainConfig) {
        let usual = if config.init.is_some() { self.iterations.min(config.iterations()) } else { self.iterations };
        config.iterations.get_or_insert(usual);
        config.densify.max_splats.get_or_insert(self.max_splats);
        config.residual.factor.get_or_insert(self.residual_factor);
    }
}

/// What to train, and where to write it.
#[derive(Debug)]
pub struct Plan {
    /// Its options.
    pub config: TrainConfig,
    /// The checkpoint to resume from.
    pub resumed: Option<Checkpoint>,
    /// Output folder; none: a free one below `output`.
    pub model: Option<PathBuf>,
    /// Replace the model that the output folder holds.
    pub overwrite: bool,
    /// Device memory that the training may use.
    pub gpu_memory: MemoryBudget,
    /// Time between two checkpoints; none: only when the training stops.
    pub checkpoint_every: Option<Duration>,
}

impl Plan {
    /// A training with these options, all else at its default.
    pub fn new(config: TrainConfig) -> Self {
        Self {
            config,
            resumed: None,
            model: None,
            overwrite: false,
            gpu_memory: MemoryBudget::Auto,
            checkpoint_every: Some(Duration::from_secs(120)),
        }
    }

    /// A training as the viewer's start page describes it.
    ///
    /// # Errors
    /// A path that cannot be made absolute, such as the empty one.
    pub fn wished(wish: &TrainingWish) -> Result<Self> {
        let mut config = TrainConfig::preset(wish.preset);
        config.method = wish.method;
        // Held-out photos let the window measure the training.
        config.data.eval = wish.scene.is_some();
        // Absolute: the model may be opened from another working directory.
        config.data.source = wish.scene.as_ref().map(std::path::absolute).transpose()?;
        config.iterations = wish.iterations.or(config.iterations);
        config.exposure.enabled = wish.exposure;
        Ok(Self::new(config))
    }

    /// Prepares the training. `status` is called with what is being done; `gpu` is called after the files have been read.
    pub fn start(self, gpu: impl FnOnce() -> Result<Arc<Gpu>>, status: &dyn Fn(&str)) -> Result<Session> {
        // Errors that need no GPU come first; nothing is written before everything is checked.
        let mut config = self.config.clone();
        config.validate()?;
        if self.resumed.is_none() {
            self.refuse_output()?;
        }
        let start = config.init.as_deref().filter(|_| self.resumed.is_none()).map(read_gaussians).transpose()?;
        let network = config.residual.init.as_deref().filter(|_| self.resumed.is_none());
        let network = network.map(weights::load).transpose()?;
        status("loading the photos");
        let source = config.data.source.clone();
        let scene = source.map(|source| load_scene(&config, &source, &Bars::default())).transpose()?;
        if scene.is_none() {
            refuse_scene_options(&config.data)?;
        }
        let gpu = gpu()?;
        let mut dataset = match scene {
            Some(dataset) => dataset,
            None => {
                status("ray tracing the demo scene; this takes some minutes the first time");
                if self.resumed.is_none() {
                    DemoDefaults::of(&gpu).fill(&mut config);
                    config.data.eval = true;
                }
                demo_scene(&config, &gpu)?
            }
        };
        config.adapt_to(&dataset);
        let known = dataset.notes.len();
        ibgs_train::find_points(&gpu, &mut dataset, &config, &Bars::default())?;
        dataset.notes[known..].iter().for_each(|note| stderr!("note: {note}"));
        status("preparing the training");
        let started = Instant::now();
        let raster = Arc::new(Rasterizer::new(gpu.clone()));
        gpu.warm_up()?;
        if self.resumed.is_none() {
            let evidence = ibgs_train::settle_exposure(&raster, &dataset, &mut config)?;
            evidence.into_iter().for_each(|evidence| stderr!("{evidence}"));
        }
        let mut trainer = match (&self.resumed, start) {
            (Some(checkpoint), _) => Trainer::resume(raster.clone(), &dataset, checkpoint)?,
            (None, Some(start)) => {
                config.sh_degree = Some(start.sh_degree);
                Trainer::from_gaussians(raster.clone(), &dataset, &config, &start)?
            }
            (None, None) => Trainer::new(raster.clone(), &dataset, &config)?,
        };
        if let Some(network) = &network {
            trainer.set_network(network)?;
        }
        let mut needs = estimate::Needs::of(&trainer, &raster, &dataset, &config);
        if let Some(most) = needs.limit(self.gpu_memory, &gpu)? {
            config.densify.max_splats = Some(most);
            trainer.limit_splats(most);
        }
        let (folder, lock) = match (&self.resumed, &self.model) {
            (Some(checkpoint), Some(path)) => {
                stderr!("resuming from iteration {} of {}", checkpoint.iteration(), config.iterations());
                let folder = OutputFolder::at(path);
                let lock = folder.lock()?;
                // The scene may have moved.
                config.save(&folder.config_path())?;
                (folder, lock)
            }
            _ => self.create_output(&config, &dataset)?,
        };
        let cameras: Vec<Camera> = dataset.train.iter().map(|&view| dataset.views[view].camera).collect();
        let shown = shown_by_any(&cameras, dataset.points.par_iter().map(|point| point.position));
        stderr!(
            "{} training views, {} test views, {} initial points ({shown} within the training views), {} iterations; writing to {}",
            dataset.train.len(),
            dataset.test.len(),
            dataset.points.len(),
            config.iterations(),
            folder.root().display()
        );
        stderr!("{}", needs.sentence());
        let session =
            Session::of(trainer, raster, dataset, config, started).with_output(folder, lock, self.checkpoint_every);
        Ok(match &self.resumed {
            Some(checkpoint) => session.with_records_of(checkpoint),
            None => session,
        })
    }

    /// Fails if the output folder exists and may not be used; changes nothing.
    pub(in crate::commands) fn refuse_output(&self) -> Result<()> {
        let Some(path) = self.model.as_ref().filter(|path| path.exists()) else { return Ok(()) };
        if self.config.data.source.as_ref().is_some_and(|source| files::is_same(source, path)) {
            bail!("{} is the scene itself; choose another `--model`", path.display());
        }
        OutputFolder::at(path).lock()?;
        if !(self.overwrite && path.is_dir()) {
            OutputFolder::create(path, Existing::Keep)?;
        }
        Ok(())
    }

    /// Creates the output folder and writes the files that are known before the training; removes a new folder if that
    /// fails.
    pub(in crate::commands) fn create_output(
        &self,
        config: &TrainConfig,
        dataset: &Dataset,
    ) -> Result<(OutputFolder, FolderLock)> {
        let path = match &self.model {
            Some(path) => path.clone(),
            None => self.free_folder(config.data.source.as_deref())?,
        };
        let (existing, is_new) = (if self.overwrite { Existing::Replace } else { Existing::Keep }, !path.exists());
        files::create_folder(&path)?;
        // Before anything in it is removed.
        let lock = OutputFolder::at(&path).lock()?;
        let folder = OutputFolder::create(&path, existing)?;
        if let Err(error) = folder.write_start(config, dataset) {
            if is_new {
                let _ = std::fs::remove_dir_all(&path);
            }
            return Err(error.into());
        }
        Ok((folder, lock))
    }

    fn free_folder(&self, source: Option<&Path>) -> Result<PathBuf> {
        let name = match source {
            Some(path) => path.file_stem().and_then(|n| n.to_str()).unwrap_or("scene").to_owned(),
            None => "demo".to_owned(),
        };
        let mut candidates = std::iter::once(name.clone()).chain((2..).map(|i| format!("{name}-{i}")));
        let free = candidates.find_map(|n| Some(Path::new("output").join(n)).filter(|p| !p.exists() || self.overwrite));
        free.context("no free output folder")
    }
}

/// Refuses options of photos on disk for the demo scene: they would be ignored, and still recorded in the results.
fn refuse_scene_options(data: &DataConfig) -> Result<()> {
    let usual = DataConfig::default();
    let given = [
        ("--resolution", data.resolution != usual.resolution),
        ("--resampler", data.resampler != usual.resampler),
        ("--images", data.images != usual.images),
        ("--max-resolution", data.max_resolution != usual.max_resolution),
        ("--eval-split-every", data.eval_split_every != usual.eval_split_every),
        ("--masks", data.masks != usual.masks),
        ("--alpha", data.alpha != usual.alpha),
        ("--color-space", data.color_space != usual.color_space),
        ("--initial-points", data.initial_points != usual.initial_points),
        ("--filter-points", data.filter_points != usual.filter_points),
        ("data.split", data.split != usual.split),
        ("data.extent", data.extent != usual.extent),
        ("--principal-point", data.principal_point != usual.principal_point),
    ];
    match given.iter().find(|(_, given)| *given) {
        Some((option, _)) => bail!("option `{option}` does not apply to the built-in demo scene; leave it out"),
        None => Ok(()),
    }
}

fn demo_scene(config: &TrainConfig, gpu: &Gpu) -> Result<Dataset> {
    let options = if gpu.is_software() { DemoOptions::small() } else { DemoOptions::large() };
    let dataset = load_demo(&options, config.data.demo_exposure_seed, &Bars::default())?;
    for note in &dataset.notes {
        stderr!("note: {note}");
    }
    Ok(dataset)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_demo_scene_has_its_defaults_where_no_option_is_given() {
        let filled = |mut config: TrainConfig| {
            DemoDefaults::SOFTWARE.fill(&mut config);
            (config.iterations(), config.densify.most(), config.residual.factor())
        };
        assert_eq!(filled(TrainConfig::default()), (200, 12_000, 0.5));
        let mut given = TrainConfig { iterations: Some(7), ..TrainConfig::default() };
        (given.densify.max_splats, given.residual.factor) = (Some(500), Some(0.25));
        assert_eq!(filled(given), (7, 500, 0.25));
        let mut warm = TrainConfig { init: Some("model.ply".into()), ..TrainConfig::default() };
        DemoDefaults::GPU.fill(&mut warm);
        assert_eq!(warm.iterations(), 3_000);
    }
}
