//! The parameters of Gaussians as arrays.

use crate::arrays::{array, values};
use crate::errors::{raised, refused};
use ibgs_core::scene::{self, Format, read_gaussians, write_gaussians};
use numpy::{PyArrayDyn, PyReadonlyArrayDyn};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// Gaussians, every value as it is trained.
#[pyclass(frozen, module = "ibgs")]
pub struct Gaussians(pub scene::Gaussians);

impl Gaussians {
    /// The width of each field, by its name here.
    fn shapes(&self) -> [(&'static str, Vec<usize>); 7] {
        let (n, coefficients) = (self.0.len(), self.0.sh_coefficients());
        [
            ("means", vec![n, 3]),
            ("rotations", vec![n, 4]),
            ("log_scales", vec![n, 3]),
            ("opacity_logits", vec![n]),
            ("sh", vec![n, coefficients, 3]),
            ("normals", vec![n, 3]),
            ("offsets", vec![n]),
        ]
    }

    fn field<'py>(&self, py: Python<'py>, number: usize, values: &[f32]) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        array(py, values.to_vec(), &self.shapes()[number].1)
    }
}

#[pymethods]
impl Gaussians {
    /// Reads a file of Gaussians of any format that the program reads.
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        py.detach(|| read_gaussians(&path)).map(Self).map_err(raised)
    }

    /// Writes a file of Gaussians; its ending names the format.
    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let format = Format::of_name(&path)
            .ok_or_else(|| refused(format!("{}: its ending names no format of Gaussians", path.display())))?;
        py.detach(|| write_gaussians(&path, &self.0, format)).map_err(raised)
    }

    /// The same with other values: an array for each field that changes.
    #[pyo3(signature = (**fields))]
    fn replaced(&self, fields: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let mut own = self.0.values().map(<[f32]>::to_vec);
        for (key, given) in fields.into_iter().flatten() {
            let name = key.extract::<String>()?;
            let shapes = self.shapes();
            let Some((_, shape)) = shapes.iter().find(|(field, _)| *field == name) else {
                let known = shapes.map(|(field, _)| field).join(", ");
                return Err(refused(format!("Gaussians have no field `{name}`; they have {known}")));
            };
            let given = values(&given.extract::<PyReadonlyArrayDyn<f32>>()?, shape, &name)?;
            let field = match name.as_str() {
                "means" => &mut own.means,
                "rotations" => &mut own.rotations,
                "log_scales" => &mut own.log_scales,
                "opacity_logits" => &mut own.opacity_logits,
                "sh" => &mut own.sh,
                "normals" => &mut own.normals,
                _ => &mut own.offsets,
            };
            *field = given;
        }
        let changed = scene::Gaussians::from_values(self.0.space, self.0.sh_degree, own);
        changed.validate().map_err(raised)?;
        Ok(Self(changed))
    }

    /// Those for which a mask is true, in their order.
    fn chosen(&self, mask: PyReadonlyArrayDyn<bool>) -> PyResult<Self> {
        let mask: Vec<bool> = mask.as_array().iter().copied().collect();
        if mask.len() != self.0.len() {
            return Err(refused(format!("the mask has {} values for {} Gaussians", mask.len(), self.0.len())));
        }
        let count = mask.iter().filter(|chosen| **chosen).count();
        Ok(Self(self.0.rows(count, (0..mask.len()).filter(|&i| mask[i]))))
    }

    #[getter]
    fn means<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        self.field(py, 0, self.0.means.as_flattened())
    }

    #[getter]
    fn rotations<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        self.field(py, 1, self.0.rotations.as_flattened())
    }

    #[getter]
    fn log_scales<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        self.field(py, 2, self.0.log_scales.as_flattened())
    }

    #[getter]
    fn opacity_logits<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        self.field(py, 3, &self.0.opacity_logits)
    }

    #[getter]
    fn sh<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        self.field(py, 4, &self.0.sh)
    }

    #[getter]
    fn normals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        self.field(py, 5, self.0.normals.as_flattened())
    }

    #[getter]
    fn offsets<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        self.field(py, 6, &self.0.offsets)
    }

    /// The means in the scene's coordinates.
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let positions = self.0.positions().flat_map(|place| place.to_array()).collect();
        array(py, positions, &[self.0.len(), 3])
    }

    /// Origin and unit of the local coordinates: a point of the scene is `origin + unit * mean`.
    #[getter]
    fn space(&self) -> ([f64; 3], f64) {
        (self.0.space.origin.to_array(), self.0.space.scale)
    }

    #[getter]
    fn sh_degree(&self) -> u32 {
        self.0.sh_degree
    }

    fn __len__(&self) -> usize {
        self.0.len()
    }

    fn __repr__(&self) -> String {
        format!("Gaussians({}, degree {})", self.0.len(), self.0.sh_degree)
    }
}
