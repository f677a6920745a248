//! From the options of `ibgs train` to a training.

use super::Args;
use super::start::{Reports, output};
use anyhow::{Result, bail};
use clap::Parser;
use ibgs_core::config::{Background, ConfigError, PoseSwitch, TrainConfig};
use ibgs_core::output::Existing;
use ibgs_core::words::count;
use ibgs_train::Session;
use ibgs_train::session::{Output, SessionBuilder, StoppedTraining};
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Why a block refines no cameras.
const SHARED_CAMERAS: &str = "the blocks of a scene share their cameras, so none may move them; give `ibgs split` the option \
                              `--refine-poses auto`, which adjusts them before the blocks";

/// A line of options alone.
#[derive(Parser)]
struct Line {
    #[command(flatten)]
    args: Args,
}

/// Parses a number of Gaussians.
pub fn splats(text: &str) -> Result<u32, String> {
    count(text).ok_or_else(|| "write it as 5000, 100k or 1.5M".to_owned())
}

/// Parses a number of minutes, up to a year.
pub fn minutes(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(minutes) if (0.0..=525_600.0).contains(&minutes) => Ok(minutes),
        _ => Err("give a number of minutes, 0 or above".to_owned()),
    }
}

/// Overrides an option with a value that is given.
pub fn set<T>(option: &mut T, value: &Option<T>)
where
    T: Clone,
{
    if let Some(value) = value {
        *option = value.clone();
    }
}

/// The same for an option that may be unset.
pub fn set_some<T: Clone>(option: &mut Option<T>, value: &Option<T>) {
    if value.is_some() {
        option.clone_from(value);
    }
}

impl Args {
    /// The training that the command line describes.
    ///
    /// # Errors
    /// The options file is damaged, or there is nothing to resume.
    pub(super) fn training(&self) -> Result<SessionBuilder> {
        let training = match self.model.as_deref().filter(|_| self.resume) {
            Some(path) => self.resumed(path)?,
            None => self.new_training()?,
        };
        let minutes = self.checkpoint_every;
        let every = (minutes > 0.0).then(|| Duration::from_secs_f64(60.0 * minutes));
        Ok(training.gpu_memory(self.gpu_memory).checkpoint_every(every))
    }

    fn new_training(&self) -> Result<SessionBuilder> {
        let (config, output) = self.new_output()?;
        Ok(Session::builder(config).output(output))
    }

    fn new_output(&self) -> Result<(TrainConfig, Output)> {
        let file = self.file()?;
        let config = self.config(file.as_ref().map(|(text, path)| (&**text, *path)))?;
        let existing = if self.overwrite { Existing::Replace } else { Existing::Keep };
        let output = output(self.model.as_deref(), existing, &config);
        Ok((config, output))
    }

    /// Refuses options that a new training would refuse after its scene is there.
    ///
    /// # Errors
    /// An option with a wrong value; an output folder that may not be used.
    pub(super) fn check(&self) -> Result<()> {
        let (config, output) = self.new_output()?;
        config.validate()?;
        Ok(output.check(config.source.as_deref())?)
    }

    /// The stopped training in a folder, with the options of the command line over its own.
    fn resumed(&self, path: &Path) -> Result<SessionBuilder> {
        let stopped = StoppedTraining::open(path, &mut Reports::to(&|_| {}))?;
        let mut config = self.over(stopped.checkpoint().config.clone())?;
        // A plan of blocks may have moved.
        if let Some(plan) = &self.base {
            config.source.clone_from(&plan.source);
            config.data.split.clone_from(&plan.data.split);
            config.poses.cameras.clone_from(&plan.poses.cameras);
        }
        Ok(Session::builder(config).resumed_from(stopped))
    }

    /// The options file's text, and its path.
    fn file(&self) -> Result<Option<(String, &Path)>> {
        let read = |path: &PathBuf| {
            fs::read_to_string(path).map_err(|source| ConfigError::Read { path: path.clone(), source })
        };
        let text = self.config.as_ref().map(read).transpose()?;
        Ok(text.zip(self.config.as_deref()))
    }

    /// The options file, overridden by the command line.
    fn config(&self, file: Option<(&str, &Path)>) -> Result<TrainConfig> {
        let given = file.map(|(text, path)| TrainConfig::from_text(text, path)).transpose()?;
        let base = || self.base.clone().unwrap_or_else(|| TrainConfig::preset(self.preset.unwrap_or_default()));
        let mut config = self.over(given.unwrap_or_else(base))?;
        // As the scene: the model may be opened from another working directory.
        let (init, network) = (&mut config.init, &mut config.residual.init);
        for path in [init, network, &mut config.data.split, &mut config.poses.cameras].into_iter().flatten() {
            *path = std::path::absolute(&*path)?;
        }
        Ok(config)
    }

    /// The options that the command line describes, for trainings of blocks.
    ///
    /// # Errors
    /// The options file is damaged, or an option has nothing to do with what is trained.
    pub fn shared_config(&self) -> Result<TrainConfig> {
        let usual = Self::parse(&[])?;
        let refused = [
            ("SCENE", self.scene.is_some() || self.source.is_some()),
            ("--block", self.block.is_some()),
            ("--prepare", self.prepare),
            ("--resume", self.resume),
            ("--init", self.init.is_some()),
            ("--model", self.model.is_some()),
            ("--overwrite", self.overwrite),
            ("--log-json", self.log_json.is_some()),
            ("--with-viewer", self.with_viewer),
            ("--checkpoint-every", self.checkpoint_every != usual.checkpoint_every),
            ("--gpu-memory", self.gpu_memory != usual.gpu_memory),
            ("--adapter", self.adapter.is_some()),
        ];
        if let Some((option, _)) = refused.iter().find(|(_, given)| *given) {
            bail!("`{option}` is no option that all blocks share; leave it out after `--`");
        }
        let file = self.file()?;
        let config = self.config(file.as_ref().map(|(text, path)| (&**text, *path)))?;
        config.validate()?;
        if config.init.is_some() {
            bail!("blocks begin with their own points; leave the option `init` out of the options file");
        }
        if config.poses.refine == PoseSwitch::On {
            bail!(SHARED_CAMERAS);
        }
        Ok(config)
    }

    /// Parses options of `ibgs train`.
    ///
    /// # Errors
    /// An option that is unknown or has a wrong value, in clap's words.
    pub fn parse(options: &[OsString]) -> Result<Self, clap::Error> {
        Line::try_parse_from(std::iter::once(&OsString::from("ibgs train")).chain(options)).map(|line| line.args)
    }

    /// `c`, overridden by the command line.
    fn over(&self, mut c: TrainConfig) -> Result<TrainConfig> {
        set(&mut c.method, &self.method);
        // Absolute: the model may be opened from another working directory.
        let source = self.scene.as_ref().or(self.source.as_ref()).map(std::path::absolute).transpose()?;
        set_some(&mut c.source, &source);
        set(&mut c.data.resolution, &self.resolution);
        set(&mut c.data.resampler, &self.resampler);
        set_some(&mut c.data.images, &self.images);
        set_some(&mut c.data.max_resolution, &self.max_resolution);
        set(&mut c.data.eval_split_every, &self.eval_split_every);
        set(&mut c.data.principal_point, &self.principal_point);
        set_some(&mut c.data.masks, &self.masks);
        set_some(&mut c.data.alpha, &self.alpha);
        set_some(&mut c.data.color_space, &self.color_space);
        set(&mut c.data.initial_points, &self.initial_points);
        c.data.filter_points |= self.filter_points;
        c.data.eval |= self.eval || self.eval_split_every.is_some();
        set_some(&mut c.iterations, &self.iterations);
        c.schedule_scaling &= !self.no_schedule_scaling;
        set_some(&mut c.sh_degree, &self.sh_degree);
        set_some(&mut c.init, &self.init.as_ref().map(std::path::absolute).transpose()?);
        set_some(&mut c.sh_interval, &self.sh_interval);
        set_some(&mut c.learning_rates.mean_iterations, &self.mean_iterations);
        set_some(&mut c.densify.start, &self.densify_start);
        set_some(&mut c.densify.end, &self.densify_end);
        set_some(&mut c.densify.interval, &self.densify_interval);
        set_some(&mut c.opacity_reset.interval, &self.opacity_reset_interval);
        set(&mut c.densify.strategy, &self.densify);
        set_some(&mut c.densify.max_splats, &self.max_splats);
        set(&mut c.eval_every, &self.eval_every);
        set_some(&mut c.eval_iterations, &self.eval_iterations);
        set_some(&mut c.save_iterations, &self.save_iterations);
        set(&mut c.seed, &self.seed);
        set_some(&mut c.ensemble, &self.ensemble);
        set_some(&mut c.background, &self.background.or(self.white_background.then_some(Background::WHITE)));
        c.deterministic |= self.deterministic;
        self.stages.apply(&mut c);
        if self.base.is_some() && c.poses.refine != PoseSwitch::Off {
            bail!(SHARED_CAMERAS);
        }
        Ok(c)
    }
}
