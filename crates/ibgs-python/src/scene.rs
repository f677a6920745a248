//! Scenes: posed photos and points.

use crate::arrays::array;
use crate::camera::View;
use crate::errors::{raised, refused};
use crate::options::changed;
use ibgs::commands::train::demo::demo_scene;
use ibgs_core::config::TrainConfig;
use ibgs_core::dataset::{Dataset, LoadOptions, load};
use ibgs_core::output::cameras::records;
use ibgs_demo::DemoOptions;
use numpy::PyArrayDyn;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// A scene, loaded.
#[pyclass(frozen, module = "ibgs")]
pub struct Scene {
    pub dataset: Dataset,
    /// Its options: where it comes from and how it was loaded.
    pub config: TrainConfig,
}

#[pymethods]
impl Scene {
    /// Loads a folder of posed photos.
    #[staticmethod]
    #[pyo3(signature = (path, **options))]
    fn load(py: Python<'_>, path: PathBuf, options: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let data = changed(&LoadOptions::default(), options)?;
        let source = std::path::absolute(path)?;
        let config = TrainConfig { source: Some(source.clone()), data, ..TrainConfig::default() };
        config.validate().map_err(raised)?;
        let dataset = py.detach(|| load(&source, &config.load_options())).map_err(raised)?;
        Ok(Self { dataset, config })
    }

    /// Ray traces the built-in scene.
    #[staticmethod]
    #[pyo3(signature = (size = "small", walkers = 0))]
    fn demo(py: Python<'_>, size: &str, walkers: u32) -> PyResult<Self> {
        let options = match size {
            "small" => DemoOptions::small(),
            "large" => DemoOptions::large(),
            _ => return Err(refused(format!("size: `{size}` is neither `small` nor `large`"))),
        };
        let mut config = TrainConfig { demo_walkers: walkers, ..TrainConfig::default() };
        config.data.eval = true;
        config.validate().map_err(raised)?;
        let dataset = py.detach(|| demo_scene(options.width, &config, &())).map_err(raised)?;
        Ok(Self { dataset, config })
    }

    #[getter]
    fn views(&self) -> Vec<View> {
        records(&self.dataset).iter().map(View::from).collect()
    }

    /// The pixels of a view's photo.
    fn photo<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyArrayDyn<u8>>> {
        let view = self.dataset.views.iter().find(|view| view.name == name);
        let view = view.ok_or_else(|| refused(format!("the scene has no photo `{name}`")))?;
        let photo = py.detach(|| view.photo.pixels()).map_err(raised)?;
        array(py, photo.rgba.clone(), &[photo.height as usize, photo.width as usize, 4])
    }

    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let points = &self.dataset.points;
        array(py, points.iter().flat_map(|point| point.position.to_array()).collect(), &[points.len(), 3])
    }

    #[getter]
    fn colors<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<u8>>> {
        let points = &self.dataset.points;
        array(py, points.iter().flat_map(|point| point.color).collect(), &[points.len(), 3])
    }

    fn __repr__(&self) -> String {
        let Dataset { train, test, points, .. } = &self.dataset;
        format!("Scene({} training views, {} held out, {} points)", train.len(), test.len(), points.len())
    }
}
