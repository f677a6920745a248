//! Errors of the libraries as one exception of Python.

use ibgs::advice;
use pyo3::exceptions::PyRuntimeError;
use pyo3::{PyErr, create_exception};

create_exception!(
    _ibgs,
    Error,
    PyRuntimeError,
    "What cannot be done, in the sentence of the command line: file, field, and what helps."
);

/// An error of any library.
pub fn raised(error: impl Into<anyhow::Error>) -> PyErr {
    Error::new_err(advice::sentence(&error.into()))
}

/// A sentence of ours.
pub fn refused(sentence: impl Into<String>) -> PyErr {
    Error::new_err(sentence.into())
}
