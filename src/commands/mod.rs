//! One module per command: parse, call the libraries, print.

pub mod bench;
pub mod compare;
pub mod completions;
pub mod eval;
pub mod export;
pub mod info;
pub mod man;
pub mod merge;
pub mod mesh;
mod model;
pub mod prepare;
pub mod render;
pub mod report;
pub mod serve;
pub mod split;
pub mod suite;
pub mod train;
pub mod view;

use crate::stderr;
use anyhow::Result;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use ibgs_core::config::Strategy;
use ibgs_core::gpu::{AdapterChoice, Gpu, Use};
use ibgs_core::words::words;
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::sync::Arc;

/// Opens the adapter that `--adapter` names, for this use.
pub fn open_gpu(adapter: Option<&String>, wanted: Use) -> Result<Arc<Gpu>> {
    let choice = adapter.map_or(AdapterChoice::Best, |name| AdapterChoice::Named(name.clone()));
    let gpu = Gpu::open(&choice, wanted)?;
    stderr!("adapter: {}", gpu.describe());
    Ok(gpu)
}

/// Parses one of the words of an enum, as the options file has them.
fn word<T>() -> impl TypedValueParser<Value = T>
where
    T: DeserializeOwned + Clone + Send + Sync + 'static,
{
    word_of(words::<T>())
}

/// The same where help says more of each word.
fn word_of<T>(values: impl Into<PossibleValuesParser>) -> impl TypedValueParser<Value = T>
where
    T: DeserializeOwned + Clone + Send + Sync + 'static,
{
    values.into().try_map(|word| serde_json::from_value(Value::String(word)))
}

/// Parses a strategy of densification; help says what each does.
fn strategy() -> impl TypedValueParser<Value = Strategy> {
    let strategies = words::<Strategy>().iter().zip(Strategy::ALL);
    word_of(PossibleValuesParser::new(strategies.map(|(word, own)| PossibleValue::new(*word).help(own.meaning()))))
}
