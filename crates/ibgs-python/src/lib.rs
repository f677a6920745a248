//! The Python package `ibgs`: scenes, training and rendering in the process, in numpy arrays.
//!
//! Nothing here computes: each class holds what the Rust libraries have under the same name, releases Python's lock while it works
//! and hands over arrays without a copy. Shapes and units stand in `__init__.pyi`.

mod arrays;
mod camera;
mod command;
mod errors;
mod gaussians;
mod metrics;
mod model;
mod options;
mod scene;
mod trainer;

use pyo3::pymodule;

/// The compiled part of the package; `ibgs` re-exports all of it.
#[pymodule]
mod _ibgs {
    use pyo3::prelude::*;

    #[pymodule_export]
    use super::camera::{Camera, View};
    #[pymodule_export]
    use super::command::run;
    #[pymodule_export]
    use super::errors::Error;
    #[pymodule_export]
    use super::gaussians::Gaussians;
    #[pymodule_export]
    use super::metrics::{psnr, ssim, to_uint8};
    #[pymodule_export]
    use super::model::Model;
    #[pymodule_export]
    use super::options::defaults;
    #[pymodule_export]
    use super::scene::Scene;
    #[pymodule_export]
    use super::trainer::{Progress, Trainer};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
