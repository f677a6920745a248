//! The command line, in the process.

use crate::errors::raised;
use clap::Parser;
use ibgs::Cli;
use ibgs::signals::Stopped;
use pyo3::exceptions::{PyKeyboardInterrupt, PySystemExit};
use pyo3::prelude::*;

/// Runs a command as `ibgs` does, and returns when it is done.
#[pyfunction]
pub fn run(py: Python<'_>, arguments: Vec<String>) -> PyResult<()> {
    let words = std::iter::once("ibgs".to_owned()).chain(arguments);
    let cli = match Cli::try_parse_from(words) {
        Ok(cli) => cli,
        Err(error) => {
            // Help and version come here too, with 0.
            let code = error.exit_code();
            let _ = error.print();
            return Err(PySystemExit::new_err(code));
        }
    };
    py.detach(|| cli.run()).map_err(|error| match error.is::<Stopped>() {
        true => PyKeyboardInterrupt::new_err(error.to_string()),
        false => raised(error),
    })
}
