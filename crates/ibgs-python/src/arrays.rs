//! Vectors of numbers as arrays of numpy, and back.

use crate::errors::refused;
use numpy::{Element, PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// An array of this shape that takes the vector's memory.
pub fn array<'py, T: Element>(py: Python<'py>, values: Vec<T>, shape: &[usize]) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    PyArray1::from_vec(py, values).reshape(shape)
}

/// The numbers of an array of float32, row by row, where its shape is the one that is asked for; `name` is for messages.
pub fn values(array: &PyReadonlyArrayDyn<f32>, shape: &[usize], name: &str) -> PyResult<Vec<f32>> {
    if array.shape() != shape {
        return Err(refused(format!("`{name}` has the shape {:?}, not {shape:?}", array.shape())));
    }
    Ok(array.as_array().iter().copied().collect())
}
