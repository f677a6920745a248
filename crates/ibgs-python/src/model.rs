//! Trained models: opened, rendered, measured.

use crate::arrays::array;
use crate::camera::{Pose, View};
use crate::errors::{raised, refused};
use crate::gaussians::Gaussians;
use crate::options::{of_table, word};
use ibgs::commands::train::demo::MAKE_DEMO;
use ibgs_core::camera::Camera;
use ibgs_core::eval::scores::score_test_views;
use ibgs_core::gpu::{AdapterChoice, Gpu, GpuError, Use};
use ibgs_core::inspect::{Inspection, Verdict};
use ibgs_core::model::{self, ModelOptions};
use ibgs_core::output::results::{ViewScore, means};
use ibgs_core::render::{Frame, Rendered, Renderer};
use ibgs_core::residual::Precision;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use toml::Table;

/// What a frame can be read as.
const OUTPUTS: [&str; 6] = ["final", "base", "residual", "depth", "normals", "visibility"];

/// A trained model on a GPU.
#[pyclass(frozen, module = "ibgs")]
pub struct Model {
    gpu: Arc<Gpu>,
    state: Mutex<State>,
}

struct State {
    model: model::Model,
    /// Made when it is first needed, and again when the Gaussians have changed.
    renderer: Option<Renderer>,
}

impl Model {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The images of a camera, read back; `outputs` are checked.
    fn images(&self, camera: &Camera, outputs: &[String]) -> PyResult<Vec<Image>> {
        let mut state = self.state();
        let needs_surface = outputs.iter().any(|output| ["depth", "normals"].contains(&output.as_str()));
        let renderer = state.renderer(&self.gpu, needs_surface)?;
        if let Some(output) = outputs.iter().find(|output| needs_network(output) && renderer.part().is_none()) {
            return Err(refused(format!("the model has no residual network, so no `{output}`")));
        }
        let frame = renderer.render(camera).map_err(raised)?;
        read(&frame, outputs).map_err(raised)
    }
}

impl State {
    /// `shows_surface`: for frames with depth and normals, which a model without a network finds for nothing else.
    fn renderer(&mut self, gpu: &Arc<Gpu>, shows_surface: bool) -> PyResult<&Renderer> {
        let made = self.renderer.take().map_or_else(|| self.model.renderer(gpu).map_err(raised), Ok)?;
        Ok(self.renderer.insert(if shows_surface { made.showing_surface() } else { made }))
    }
}

/// Refuses outputs that are unknown.
pub fn check(outputs: &[String]) -> PyResult<()> {
    match outputs.iter().find(|output| !OUTPUTS.contains(&output.as_str())) {
        Some(output) => Err(refused(format!("no output `{output}`; there are {}", OUTPUTS.join(", ")))),
        None => Ok(()),
    }
}

/// Opens an adapter by its number or a part of its name, or the most capable one.
pub fn open_gpu(adapter: Option<String>, wanted: Use) -> PyResult<Arc<Gpu>> {
    Gpu::open(&adapter.map_or(AdapterChoice::Best, AdapterChoice::Named), wanted).map_err(raised)
}

fn needs_network(output: &str) -> bool {
    ["residual", "visibility"].contains(&output)
}

/// One output of a frame on the host.
pub enum Image {
    Floats(Vec<f32>, Vec<usize>),
    Counts(Vec<u32>, Vec<usize>),
}

impl Image {
    /// Reads an output; the final image of a model without a network is its base image.
    fn of(frame: &Frame, output: &str) -> Result<Self, GpuError> {
        let [height, width] = [frame.camera().height, frame.camera().width].map(|size| size as usize);
        let color = |image: Rendered| Self::Floats(image.rgb, vec![height, width, 3]);
        Ok(match output {
            "final" => color(final_image(frame)?),
            "base" => color(frame.base()?),
            "residual" => {
                let (mut image, base) = (final_image(frame)?, frame.base()?);
                image.rgb.iter_mut().zip(base.rgb).for_each(|(value, base)| *value -= base);
                color(image)
            }
            "depth" => Self::Floats(frame.depth()?.unwrap_or_default(), vec![height, width]),
            "normals" => Self::Floats(frame.normals()?.unwrap_or_default(), vec![height, width, 3]),
            _ => Self::Counts(frame.visibility()?.unwrap_or_default(), vec![height, width]),
        })
    }

    /// An output of many frames, into which they are put one after the other.
    fn of_many(self, frames: usize) -> Self {
        fn longer<T>(mut values: Vec<T>, mut shape: Vec<usize>, frames: usize) -> (Vec<T>, Vec<usize>) {
            values.reserve_exact(values.len() * (frames - 1));
            shape.insert(0, frames);
            (values, shape)
        }
        match self {
            Self::Floats(values, shape) => {
                let (values, shape) = longer(values, shape, frames);
                Self::Floats(values, shape)
            }
            Self::Counts(values, shape) => {
                let (values, shape) = longer(values, shape, frames);
                Self::Counts(values, shape)
            }
        }
    }

    /// Puts the same output of the next frame behind it.
    fn append(&mut self, next: Self) {
        match (self, next) {
            (Self::Floats(all, _), Self::Floats(values, _)) => all.extend(values),
            (Self::Counts(all, _), Self::Counts(values, _)) => all.extend(values),
            _ => unreachable!("an output is of one kind"),
        }
    }

    /// As an array that takes its memory.
    pub fn into_array(self, py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
        Ok(match self {
            Self::Floats(values, shape) => array(py, values, &shape)?.into_any(),
            Self::Counts(values, shape) => array(py, values, &shape)?.into_any(),
        })
    }
}

fn final_image(frame: &Frame) -> Result<Rendered, GpuError> {
    frame.image()?.map_or_else(|| frame.base(), Ok)
}

/// Reads outputs of a frame.
pub fn read(frame: &Frame, outputs: &[String]) -> Result<Vec<Image>, GpuError> {
    outputs.iter().map(|output| Image::of(frame, output)).collect()
}

/// Images by the names of their outputs.
pub fn named<'py>(py: Python<'py>, outputs: &[String], images: Vec<Image>) -> PyResult<Bound<'py, PyDict>> {
    let all = PyDict::new(py);
    for (output, image) in outputs.iter().zip(images) {
        all.set_item(output, image.into_array(py)?)?;
    }
    Ok(all)
}

#[pymethods]
impl Model {
    /// Opens a model folder or a bundle.
    #[staticmethod]
    #[pyo3(signature = (path, *, iteration = None, source = None, precision = "full", adapter = None))]
    fn open(
        py: Python<'_>,
        path: PathBuf,
        iteration: Option<u32>,
        source: Option<PathBuf>,
        precision: &str,
        adapter: Option<String>,
    ) -> PyResult<Self> {
        let precision: Precision = word("precision", precision)?;
        let options = ModelOptions {
            iteration,
            source,
            precision,
            harmonics: precision.of_colors(),
            make_scene: Some(MAKE_DEMO),
            ..ModelOptions::default()
        };
        py.detach(|| {
            let model = model::Model::open(&path, &options).map_err(raised)?;
            let gpu = open_gpu(adapter, Use::Rendering)?;
            Ok(Self { gpu, state: Mutex::new(State { model, renderer: None }) })
        })
    }

    #[getter]
    fn views(&self) -> Vec<View> {
        self.state().model.cameras.iter().map(View::from).collect()
    }

    #[getter]
    fn iteration(&self) -> u32 {
        self.state().model.iteration
    }

    #[getter]
    fn adapter(&self) -> String {
        self.gpu.describe()
    }

    /// The options that it was trained with.
    #[getter]
    fn options<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let config = self.state().model.config.clone();
        of_table(py, &Table::try_from(config).map_err(|error| refused(error.to_string()))?)
    }

    /// The Gaussians of its first base.
    #[getter]
    fn gaussians(&self) -> Gaussians {
        Gaussians(self.state().model.gaussians.clone())
    }

    #[setter]
    fn set_gaussians(&self, gaussians: &Gaussians) -> PyResult<()> {
        let mut state = self.state();
        if state.model.levels.is_some() {
            return Err(refused("the Gaussians of a bundle with levels of detail cannot be changed"));
        }
        state.model.gaussians = gaussians.0.clone();
        state.renderer = None;
        Ok(())
    }

    /// Renders a camera.
    #[pyo3(signature = (camera, outputs = vec!["final".to_owned()]))]
    fn render<'py>(&self, py: Python<'py>, camera: Pose<'py>, outputs: Vec<String>) -> PyResult<Bound<'py, PyDict>> {
        check(&outputs)?;
        let camera = camera.camera();
        let images = py.detach(|| self.images(&camera, &outputs))?;
        named(py, &outputs, images)
    }

    /// Renders cameras of one size.
    #[pyo3(signature = (cameras, outputs = vec!["final".to_owned()]))]
    fn render_many<'py>(
        &self,
        py: Python<'py>,
        cameras: Vec<Pose<'py>>,
        outputs: Vec<String>,
    ) -> PyResult<Bound<'py, PyDict>> {
        check(&outputs)?;
        let cameras: Vec<Camera> = cameras.iter().map(Pose::camera).collect();
        let size = |camera: &Camera| [camera.width, camera.height];
        let Some(first) = cameras.first() else { return Err(refused("no cameras are given")) };
        if let Some(other) = cameras.iter().find(|camera| size(camera) != size(first)) {
            let [[w, h], [w2, h2]] = [first, other].map(size);
            return Err(refused(format!(
                "cameras of one size can be rendered together, not {w} x {h} and {w2} x {h2}"
            )));
        }
        let mut all: Vec<Image> = Vec::new();
        for camera in &cameras {
            let images = py.detach(|| self.images(camera, &outputs))?;
            py.check_signals()?;
            match all.is_empty() {
                true => all = images.into_iter().map(|image| image.of_many(cameras.len())).collect(),
                false => all.iter_mut().zip(images).for_each(|(all, image)| all.append(image)),
            }
        }
        named(py, &outputs, all)
    }

    /// What a pixel shows, and what each source photo says about it.
    fn inspect<'py>(&self, py: Python<'py>, camera: Pose<'py>, x: u32, y: u32) -> PyResult<Option<Bound<'py, PyDict>>> {
        let camera = camera.camera();
        let (found, names) = py.detach(|| {
            let mut state = self.state();
            let frame = state.renderer(&self.gpu, true)?.render(&camera).map_err(raised)?;
            let names = state.model.training_views().iter().map(|record| record.name.clone()).collect::<Vec<_>>();
            Ok::<_, PyErr>((frame.inspect(x, y).map_err(raised)?, names))
        })?;
        found.map(|pixel| inspected(py, &pixel, &names)).transpose()
    }

    /// Scores of the held-out views.
    fn evaluate<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let scores = py.detach(|| {
            let mut state = self.state();
            state.renderer(&self.gpu, false)?;
            let State { model, renderer } = &mut *state;
            let renderer = renderer.as_ref().expect("just made");
            let config = model.config.clone();
            let dataset = model.dataset(&()).map_err(raised)?;
            if dataset.test.is_empty() {
                return Err(refused("the scene has no held-out views; train with `data={'eval': True}`"));
            }
            score_test_views(renderer, dataset, &config, None, None, &mut |_, _| {}).map_err(raised)
        })?;
        let all = PyDict::new(py);
        for (name, views) in [("base", &scores.base), ("final", &scores.image)] {
            if !views.is_empty() {
                all.set_item(name, scored(py, views)?)?;
            }
        }
        Ok(all)
    }

    fn __repr__(&self) -> String {
        let state = self.state();
        let model = &state.model;
        format!("Model({}, iteration {}, {} Gaussians)", model.path.display(), model.iteration, model.gaussians.len())
    }
}

/// Mean scores, and those of each view.
fn scored<'py>(py: Python<'py>, views: &[ViewScore]) -> PyResult<Bound<'py, PyDict>> {
    let (all, mean, each) = (PyDict::new(py), means(views), PyDict::new(py));
    all.set_item("psnr", mean.psnr)?;
    all.set_item("ssim", mean.ssim)?;
    for view in views {
        let own = PyDict::new(py);
        own.set_item("psnr", view.psnr)?;
        own.set_item("ssim", view.ssim)?;
        each.set_item(&view.name, own)?;
    }
    all.set_item("views", each)?;
    Ok(all)
}

fn inspected<'py>(py: Python<'py>, pixel: &Inspection, names: &[String]) -> PyResult<Bound<'py, PyDict>> {
    let all = PyDict::new(py);
    all.set_item("base", pixel.base)?;
    all.set_item("final", pixel.image)?;
    all.set_item("depth", pixel.median_depth)?;
    all.set_item("point", pixel.point.map(|point| point.to_array()))?;
    let sources = PyList::empty(py);
    for source in &pixel.sources {
        let own = PyDict::new(py);
        own.set_item("name", names.get(source.view))?;
        own.set_item("used", matches!(source.verdict, Verdict::Used { .. }))?;
        own.set_item("verdict", format!("{:?}", source.verdict).split(' ').next())?;
        own.set_item("place", source.place.map(|place| place.to_array()))?;
        own.set_item("color", source.color)?;
        own.set_item("cosine", source.cosine)?;
        sources.append(own)?;
    }
    all.set_item("sources", sources)?;
    Ok(all)
}
