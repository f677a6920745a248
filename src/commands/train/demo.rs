//! The built-in demo scene, which is trained on where no scene is given.

use anyhow::{Result, bail};
use ibgs_core::config::TrainConfig;
use ibgs_core::dataset::{Dataset, LoadOptions};
use ibgs_core::gpu::Gpu;
use ibgs_core::model::MakeScene;
use ibgs_core::progress::Progress;
use ibgs_demo::{DemoError, DemoOptions, RunOptions};
use ibgs_train::session::{Event, Loaded, Observer};

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

/// Refuses options of photos on disk for the demo scene: they would be ignored, and still recorded in the results.
pub fn refuse_scene_options(data: &LoadOptions) -> Result<()> {
    let usual = LoadOptions::default();
    let given = [
        ("--resolution", data.resolution != usual.resolution),
        ("--resampler", data.resampler != usual.resampler),
        ("--images", data.images != usual.images),
        ("--max-resolution", data.max_resolution != usual.max_resolution),
        ("--eval-split-every", data.eval_split_every != usual.eval_split_every),
        ("--masks", data.masks() != usual.masks()),
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

/// The demo scene with photos of this width, as the options of a training say.
pub fn demo_scene(width: u32, config: &TrainConfig, progress: &dyn Progress) -> Result<Dataset, DemoError> {
    let options = RunOptions { width, exposure_seed: config.demo_exposure_seed, walkers: config.demo_walkers };
    ibgs_demo::of_run(&options, progress)
}

/// The demo scene for a model that was trained on it.
pub const MAKE_DEMO: MakeScene = |width, config, progress| Ok(demo_scene(width, config, progress)?);

/// Gives a training on the demo scene its defaults.
pub fn adapt(training: &mut Loaded, gpu: &Gpu) {
    training.adapt(|config| {
        DemoDefaults::of(gpu).fill(config);
        config.data.eval = true;
    });
}

/// Gives a training the demo scene, and its defaults.
pub fn load(training: &mut Loaded, gpu: &Gpu, observer: &mut dyn Observer) -> Result<(), DemoError> {
    adapt(training, gpu);
    let options = if gpu.is_software() { DemoOptions::small() } else { DemoOptions::large() };
    let dataset = demo_scene(options.width, training.config(), observer.progress())?;
    dataset.notes.iter().for_each(|note| observer.event(&Event::Note(note)));
    training.set_dataset(dataset);
    Ok(())
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
