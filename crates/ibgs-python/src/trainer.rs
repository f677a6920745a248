//! Training, with Python between its iterations.

use crate::camera::Pose;
use crate::errors::{raised, refused};
use crate::model::{check, named, open_gpu, read};
use crate::options;
use crate::scene::Scene;
use ibgs::advice;
use ibgs::commands::train::demo;
use ibgs_core::config::TrainConfig;
use ibgs_core::gpu::Use;
use ibgs_core::output::Existing;
use ibgs_core::output::log::{Evaluation, TrainingProgress};
use ibgs_core::sources::memory::MemoryBudget;
use ibgs_train::Session;
use ibgs_train::session::{Event, Observer, Output, SessionBuilder, StoppedTraining};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// How far a training is.
#[pyclass(frozen, get_all, module = "ibgs")]
pub struct Progress {
    iteration: u32,
    iterations: u32,
    stage: &'static str,
    loss: Option<f32>,
    psnr: Option<f32>,
    gaussians: usize,
    seconds: f64,
}

impl From<&TrainingProgress> for Progress {
    fn from(now: &TrainingProgress) -> Self {
        let &TrainingProgress { iteration, iterations, stage, loss, psnr, gaussians, seconds, .. } = now;
        Self { iteration, iterations, stage, loss, psnr, gaussians, seconds }
    }
}

#[pymethods]
impl Progress {
    fn __repr__(&self) -> String {
        let psnr = self.psnr.map_or_else(String::new, |psnr| format!(", {psnr:.2} dB"));
        format!(
            "Progress({} of {}, {}{psnr}, {} Gaussians)",
            self.iteration, self.iterations, self.stage, self.gaussians
        )
    }
}

/// Hands iterations and events to functions of Python.
#[derive(Default)]
struct Caller {
    /// Called with [`Progress`] after each iteration; a result that is false ends the training.
    each: Option<Py<PyAny>>,
    /// Called with a sentence.
    event: Option<Py<PyAny>>,
    /// What was raised by one of them, or by a signal.
    raised: Option<PyErr>,
}

impl Caller {
    fn after(&mut self, progress: &TrainingProgress) -> PyResult<bool> {
        Python::attach(|py| {
            // Ctrl-C.
            py.check_signals()?;
            let Some(each) = &self.each else { return Ok(true) };
            let answer = each.call1(py, (Progress::from(progress),))?;
            Ok(answer.is_none(py) || answer.is_truthy(py)?)
        })
    }

    /// The result of a work, or what was raised while it was done.
    fn result<T>(self, done: PyResult<T>) -> PyResult<T> {
        self.raised.map_or(done, Err)
    }
}

impl Observer for Caller {
    fn iteration(&mut self, progress: &TrainingProgress) -> ControlFlow<()> {
        if self.raised.is_some() {
            return ControlFlow::Break(());
        }
        match self.after(progress) {
            Ok(true) => ControlFlow::Continue(()),
            Ok(false) => ControlFlow::Break(()),
            Err(error) => {
                self.raised = Some(error);
                ControlFlow::Break(())
            }
        }
    }

    fn event(&mut self, event: &Event) {
        let Some(function) = &self.event else { return };
        let called = Python::attach(|py| function.call1(py, (advice::event(event),)).map(drop));
        self.raised = self.raised.take().or(called.err());
    }
}

/// A training.
#[pyclass(frozen, module = "ibgs")]
pub struct Trainer {
    session: Mutex<Session>,
    on_event: Option<Py<PyAny>>,
}

impl Trainer {
    fn session(&self) -> MutexGuard<'_, Session> {
        self.session.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Loads and prepares a training on an adapter.
    fn prepared(
        py: Python<'_>,
        builder: SessionBuilder,
        adapter: Option<String>,
        on_event: Option<Py<PyAny>>,
    ) -> PyResult<Self> {
        let mut caller =
            Caller { event: on_event.as_ref().map(|function| function.clone_ref(py)), ..Caller::default() };
        let session = py.detach(|| {
            let mut loaded = builder.load(&mut caller).map_err(raised)?;
            let gpu = open_gpu(adapter, Use::Training)?;
            // Without a folder it is the built-in one.
            if !loaded.has_scene() {
                demo::load(&mut loaded, &gpu, &mut caller).map_err(raised)?;
            } else if loaded.config().source.is_none() {
                demo::adapt(&mut loaded, &gpu);
            }
            loaded.build(&gpu, &mut caller).map_err(raised)
        });
        Ok(Self { session: Mutex::new(caller.result(session)?), on_event })
    }

    fn caller(&self, py: Python<'_>, each: Option<Py<PyAny>>) -> Caller {
        let event = self.on_event.as_ref().map(|function| function.clone_ref(py));
        Caller { each, event, raised: None }
    }
}

#[pymethods]
impl Trainer {
    /// Prepares a training of a scene.
    #[new]
    #[pyo3(signature = (
        scene, output = None, *, preset = "default", overwrite = false, gpu_memory = "auto", adapter = None, on_event = None, **options
    ))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn new(
        py: Python<'_>,
        scene: &Scene,
        output: Option<PathBuf>,
        preset: &str,
        overwrite: bool,
        gpu_memory: &str,
        adapter: Option<String>,
        on_event: Option<Py<PyAny>>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let mut config = options::config(preset, options)?;
        let Scene { config: own, dataset } = scene;
        // How the scene was loaded is said there.
        let TrainConfig { source, data, demo_walkers, .. } = own.clone();
        (config.source, config.data, config.demo_walkers) = (source, data, demo_walkers);
        let memory: MemoryBudget =
            gpu_memory.parse().map_err(|_| refused(format!("gpu_memory: `{gpu_memory}` is no size")))?;
        let mut builder = Session::builder(config).dataset(dataset.clone()).gpu_memory(memory);
        if let Some(path) = output {
            let existing = if overwrite { Existing::Replace } else { Existing::Keep };
            builder = builder.output(Output::at(path).existing(existing));
        }
        Self::prepared(py, builder, adapter, on_event)
    }

    /// Resumes a stopped training in its own folder.
    #[staticmethod]
    #[pyo3(signature = (path, *, adapter = None, on_event = None))]
    fn resume(py: Python<'_>, path: PathBuf, adapter: Option<String>, on_event: Option<Py<PyAny>>) -> PyResult<Self> {
        let stopped = StoppedTraining::open(&path, &mut ()).map_err(raised)?;
        let builder = Session::builder(stopped.checkpoint().config.clone()).resumed_from(stopped);
        Self::prepared(py, builder, adapter, on_event)
    }

    /// Trains to the end, or until the function says that it is enough; then saves and measures.
    #[pyo3(signature = (each = None))]
    fn run(&self, py: Python<'_>, each: Option<Py<PyAny>>) -> PyResult<Progress> {
        let mut caller = self.caller(py, each);
        let done = py.detach(|| self.session().run(&mut caller)).map_err(raised);
        caller.result(done)?;
        Ok(self.progress())
    }

    /// Some iterations, and what is due after each.
    #[pyo3(signature = (count = 1))]
    fn step(&self, py: Python<'_>, count: u32) -> PyResult<Progress> {
        let mut caller = self.caller(py, None);
        let done = py.detach(|| {
            let mut session = self.session();
            for _ in 0..count {
                session.step(&mut caller).map_err(raised)?;
                if caller.iteration(&session.progress()).is_break() {
                    break;
                }
            }
            Ok(())
        });
        caller.result(done)?;
        Ok(self.progress())
    }

    /// Saves and measures the model as it is now, as after the last iteration.
    fn finish(&self, py: Python<'_>) -> PyResult<()> {
        let mut caller = self.caller(py, None);
        let done = py.detach(|| self.session().finish(&mut caller)).map_err(raised);
        caller.result(done)
    }

    #[getter]
    fn progress(&self) -> Progress {
        Progress::from(&self.session().progress())
    }

    #[getter]
    fn is_done(&self) -> bool {
        self.session().is_done()
    }

    /// The folder that it writes to.
    #[getter]
    fn output(&self) -> Option<PathBuf> {
        self.session().folder().map(|folder| folder.root().to_owned())
    }

    /// What was measured on the held-out views so far.
    #[getter]
    fn evaluations<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let evaluations = self.session().progress().evaluations;
        let entry = |at: &Evaluation| {
            let own = PyDict::new(py);
            own.set_item("iteration", at.iteration)?;
            own.set_item("gaussians", at.gaussians)?;
            own.set_item("base", at.base.psnr)?;
            own.set_item("final", at.image.map(|score| score.psnr))?;
            Ok(own)
        };
        evaluations.iter().map(entry).collect()
    }

    /// Renders a camera of the model as it is now.
    #[pyo3(signature = (camera, outputs = vec!["final".to_owned()]))]
    fn render<'py>(&self, py: Python<'py>, camera: Pose<'py>, outputs: Vec<String>) -> PyResult<Bound<'py, PyDict>> {
        check(&outputs)?;
        let camera = camera.camera();
        let images = py.detach(|| {
            let frame = self.session().renderer().map_err(raised)?.render(&camera).map_err(raised)?;
            read(&frame, &outputs).map_err(raised)
        })?;
        named(py, &outputs, images)
    }

    fn __repr__(&self) -> String {
        let Progress { iteration, iterations, .. } = self.progress();
        format!("Trainer({iteration} of {iterations} iterations)")
    }
}
