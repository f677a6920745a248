//! How a training begins, from the command line or in the window.

use super::demo;
use super::terminal::{is_status, print};
use crate::progress::Bars;
use anyhow::Result;
use ibgs_core::config::TrainConfig;
use ibgs_core::gpu::Gpu;
use ibgs_core::output::Existing;
use ibgs_core::progress::Progress;
use ibgs_train::Session;
use ibgs_train::session::{Event, Observer, Output, SessionBuilder};
use ibgs_viewer::{Status, TrainingRequest};
use std::path::Path;
use std::sync::Arc;

/// Reports work in progress to `status`, and the rest to the terminal.
pub struct Reports<'a> {
    status: &'a Status<'a>,
    bars: Bars<'a>,
}

impl<'a> Reports<'a> {
    /// With a place for work in progress.
    pub fn to(status: &'a Status<'a>) -> Self {
        Self { status, bars: Bars::telling(status, "preparing the training") }
    }
}

impl Observer for Reports<'_> {
    fn event(&mut self, event: &Event) {
        if is_status(event) {
            (self.status)(&event.to_string());
        }
        print(event);
    }

    fn progress(&self) -> &dyn Progress {
        &self.bars
    }
}

/// Where a training writes: the given folder, or a free one below `output`.
pub fn output(model: Option<&Path>, existing: Existing, config: &TrainConfig) -> Output {
    let output = match (model, &config.source) {
        (Some(path), _) => Output::at(path),
        (None, Some(source)) => free(source.file_stem().and_then(|name| name.to_str()).unwrap_or("scene")),
        (None, None) => free("demo"),
    };
    output.existing(existing)
}

fn free(name: &str) -> Output {
    Output::first_free(Path::new("output").join(name))
}

/// A training as the viewer's start page describes it.
///
/// # Errors
/// A path that cannot be made absolute, such as the empty one.
pub fn requested(request: &TrainingRequest) -> Result<SessionBuilder> {
    let mut config = TrainConfig::preset(request.preset);
    config.method = request.method;
    (config.data.eval, config.data.resolution, config.data.masks) = (request.eval, request.resolution, request.masks);
    config.densify.max_splats = request.max_splats.or(config.densify.max_splats);
    // Absolute: the model may be opened from another working directory.
    config.source = request.scene.as_ref().map(std::path::absolute).transpose()?;
    config.iterations = request.iterations.or(config.iterations);
    config.exposure.enabled = request.exposure;
    let output = output(request.model.as_deref(), Existing::Keep, &config);
    Ok(Session::builder(config).output(output))
}

/// Prepares a training, on the demo scene where it has none. `status` is called with what is being done; `gpu` is called after the
/// files have been read, because errors that need no GPU come first.
///
/// # Errors
/// What the training cannot begin with.
pub fn prepare(
    training: SessionBuilder,
    gpu: impl FnOnce() -> Result<Arc<Gpu>>,
    status: &Status<'_>,
) -> Result<Session> {
    let mut reports = Reports::to(status);
    let mut loaded = training.load(&mut reports)?;
    let is_demo = !loaded.has_scene();
    if is_demo {
        demo::refuse_scene_options(&loaded.config().data)?;
    }
    let gpu = gpu()?;
    if is_demo {
        demo::load(&mut loaded, &gpu, &mut reports)?;
    }
    Ok(loaded.build(&gpu, &mut reports)?)
}
