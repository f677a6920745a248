//! Cameras and views.

use crate::errors::refused;
use glam::{DMat3, DVec2, DVec3};
use ibgs_core::camera::{self, MAX_COORDINATE};
use ibgs_core::output::cameras::{CameraRecord, Split};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

/// A posed pinhole camera.
#[pyclass(frozen, from_py_object, module = "ibgs")]
#[derive(Clone)]
pub struct Camera(pub camera::Camera);

#[pymethods]
impl Camera {
    #[new]
    #[pyo3(signature = (width, height, focal, rotation, translation, principal = None))]
    fn new(
        width: u32,
        height: u32,
        focal: [f64; 2],
        rotation: [[f64; 3]; 3],
        translation: [f64; 3],
        principal: Option<[f64; 2]>,
    ) -> PyResult<Self> {
        let principal = principal.map_or(DVec2::new(f64::from(width), f64::from(height)) / 2.0, DVec2::from);
        // The rows are the columns of its transpose.
        let view_from_world = DMat3::from_cols_array_2d(&rotation).transpose();
        let (focal, translation) = (DVec2::from(focal), DVec3::from(translation));
        let camera = camera::Camera { width, height, focal, principal, view_from_world, translation };
        match problem(&camera) {
            Some(problem) => Err(refused(format!("this is no camera: {problem}"))),
            None => Ok(Self(camera)),
        }
    }

    #[getter]
    fn width(&self) -> u32 {
        self.0.width
    }

    #[getter]
    fn height(&self) -> u32 {
        self.0.height
    }

    #[getter]
    fn focal(&self) -> (f64, f64) {
        self.0.focal.into()
    }

    #[getter]
    fn principal(&self) -> (f64, f64) {
        self.0.principal.into()
    }

    #[getter]
    fn rotation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows = self.0.view_from_world.transpose().to_cols_array_2d();
        Ok(PyArray2::from_vec2(py, &rows.map(Vec::from))?)
    }

    #[getter]
    fn translation<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.translation.to_array())
    }

    #[getter]
    fn center<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.center().to_array())
    }

    fn resized(&self, width: u32, height: u32) -> PyResult<Self> {
        if width == 0 || height == 0 {
            return Err(refused("width and height must be at least 1"));
        }
        Ok(Self(self.0.resized(width, height)))
    }

    fn __repr__(&self) -> String {
        let camera::Camera { width, height, focal, .. } = self.0;
        format!("Camera({width} x {height}, focal {:.1}, at {:.3})", focal.x, self.0.center())
    }
}

/// Why nothing can be rendered with it; none where something can.
fn problem(camera: &camera::Camera) -> Option<&'static str> {
    let turn = camera.view_from_world;
    if camera.width == 0 || camera.height == 0 {
        Some("width and height must be at least 1")
    } else if !(camera.focal.is_finite() && camera.focal.min_element() > 0.0 && camera.principal.is_finite()) {
        Some("focal lengths must be positive, and the principal point finite")
    } else if !(turn * turn.transpose()).abs_diff_eq(DMat3::IDENTITY, 1e-4) || turn.determinant() < 0.0 {
        Some("`rotation` is no rotation")
    } else if !camera.center().is_finite() || camera.center().abs().max_element() > MAX_COORDINATE {
        Some("`translation` is too large")
    } else {
        None
    }
}

/// A camera with the name of its photo.
#[pyclass(frozen, get_all, module = "ibgs")]
pub struct View {
    name: String,
    camera: Camera,
    /// `train`, `test`, or none where nothing says.
    split: Option<&'static str>,
}

impl From<&CameraRecord> for View {
    fn from(record: &CameraRecord) -> Self {
        let CameraRecord { name, camera, split } = record;
        Self { name: name.clone(), camera: Camera(*camera), split: split.map(Split::folder) }
    }
}

#[pymethods]
impl View {
    fn __repr__(&self) -> String {
        format!("View({:?}, {})", self.name, self.split.unwrap_or("no split"))
    }
}

/// What is rendered with: a camera, or the camera of a view.
#[derive(FromPyObject)]
pub enum Pose<'py> {
    Camera(PyRef<'py, Camera>),
    View(PyRef<'py, View>),
}

impl Pose<'_> {
    pub fn camera(&self) -> camera::Camera {
        match self {
            Self::Camera(camera) => camera.0,
            Self::View(view) => view.camera.0,
        }
    }
}
