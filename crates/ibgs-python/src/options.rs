//! Options of a training as keyword arguments: the fields of the options file, with `_` in place of `-`, tables as dictionaries.

use crate::errors::refused;
use ibgs_core::config::TrainConfig;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyList, PyString};
use serde::de::DeserializeOwned;
use std::path::PathBuf;
use toml::{Table, Value};

/// Fields whose numbers are written as text.
const TEXTS: [&str; 1] = ["resolution"];

/// The options of a preset as a dictionary, nested as the options file is. Options that follow others are left out.
#[pyfunction]
#[pyo3(signature = (preset = "default"))]
pub fn defaults<'py>(py: Python<'py>, preset: &str) -> PyResult<Bound<'py, PyDict>> {
    let options = TrainConfig::preset(word("preset", preset)?);
    of_table(py, &Table::try_from(options).map_err(|error| refused(error.to_string()))?)
}

/// The options of a preset, changed by keyword arguments.
pub fn config(preset: &str, changes: Option<&Bound<'_, PyDict>>) -> PyResult<TrainConfig> {
    changed(&TrainConfig::preset(word("preset", preset)?), changes)
}

/// One of the words of an option.
pub fn word<T: DeserializeOwned>(option: &str, text: &str) -> PyResult<T> {
    Value::String(text.to_owned()).try_into().map_err(|error| refused(format!("{option}: {}", line(&error))))
}

/// Options, changed by keyword arguments.
pub fn changed<T>(options: &T, changes: Option<&Bound<'_, PyDict>>) -> PyResult<T>
where
    T: serde::Serialize + DeserializeOwned,
{
    let mut table = Table::try_from(options).map_err(|error| refused(error.to_string()))?;
    if let Some(changes) = changes {
        merge(&mut table, changes)?;
    }
    Value::Table(table).try_into().map_err(|error| refused(format!("options: {}", line(&error))))
}

/// An error's message, in one line.
fn line(error: &toml::de::Error) -> String {
    error.message().replace('\n', " ")
}

fn merge(table: &mut Table, changes: &Bound<'_, PyDict>) -> PyResult<()> {
    for (key, value) in changes {
        let key = key.extract::<String>()?.replace('_', "-");
        if value.is_none() {
            table.remove(&key);
        } else if let Ok(inner) = value.cast::<PyDict>() {
            let Value::Table(own) = table.entry(&key).or_insert_with(|| Value::Table(Table::new())) else {
                return Err(refused(format!("options: `{key}` is one value, not a dictionary")));
            };
            merge(own, inner)?;
        } else {
            let value = to_value(&key, &value)?;
            table.insert(key, value);
        }
    }
    Ok(())
}

fn to_value(key: &str, value: &Bound<'_, PyAny>) -> PyResult<Value> {
    Ok(if value.is_instance_of::<PyBool>() {
        Value::Boolean(value.extract()?)
    } else if value.is_instance_of::<PyInt>() {
        match TEXTS.contains(&key) {
            true => Value::String(value.extract::<i64>()?.to_string()),
            false => Value::Integer(value.extract()?),
        }
    } else if value.is_instance_of::<PyFloat>() {
        Value::Float(value.extract()?)
    } else if value.is_instance_of::<PyString>() {
        Value::String(value.extract()?)
    } else if let Ok(values) = value.cast::<PyList>() {
        Value::Array(values.iter().map(|value| to_value(key, &value)).collect::<PyResult<_>>()?)
    } else if let Ok(path) = value.extract::<PathBuf>() {
        Value::String(path.to_string_lossy().into_owned())
    } else if let Ok(number) = value.extract::<f64>() {
        // Of numpy.
        Value::Float(number)
    } else {
        return Err(refused(format!("options: `{key}` is no number, text, list or dictionary")));
    })
}

/// A table as a dictionary that [`changed`] takes.
pub fn of_table<'py>(py: Python<'py>, table: &Table) -> PyResult<Bound<'py, PyDict>> {
    let all = PyDict::new(py);
    for (key, value) in table {
        all.set_item(key.replace('-', "_"), of_value(py, value)?)?;
    }
    Ok(all)
}

fn of_value<'py>(py: Python<'py>, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    Ok(match value {
        Value::String(text) => text.into_pyobject(py)?.into_any(),
        Value::Integer(number) => number.into_pyobject(py)?.into_any(),
        Value::Float(number) => number.into_pyobject(py)?.into_any(),
        Value::Boolean(is_on) => is_on.into_pyobject(py)?.to_owned().into_any(),
        Value::Datetime(date) => date.to_string().into_pyobject(py)?.into_any(),
        Value::Array(values) => {
            let values = values.iter().map(|value| of_value(py, value)).collect::<PyResult<Vec<_>>>()?;
            PyList::new(py, values)?.into_any()
        }
        Value::Table(table) => of_table(py, table)?.into_any(),
    })
}
