//! One module per command: parse, call the libraries, print.

pub mod bench;
pub mod compare;
pub mod completions;
pub mod eval;
pub mod export;
pub mod info;
pub mod man;
pub mod mesh;
mod model;
pub mod prepare;
pub mod render;
pub mod report;
pub mod serve;
pub mod suite;
pub mod train;
pub mod view;

use crate::stderr;
use anyhow::Result;
use ibgs_core::gpu::{AdapterChoice, Gpu, Use};
use std::sync::Arc;

/// Opens the adapter that `--adapter` names, for this use.
pub fn open_gpu(adapter: Option<&String>, wanted: Use) -> Result<Arc<Gpu>> {
    let choice = adapter.map_or(AdapterChoice::Best, |name| AdapterChoice::Named(name.clone()));
    let gpu = Gpu::open(&choice, wanted)?;
    stderr!("adapter: {}", gpu.describe());
    Ok(gpu)
}
