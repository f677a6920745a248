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
pub mod suite;
pub mod train;
pub mod view;

use crate::stderr;
use anyhow::Result;
use ibgs_core::gpu::{AdapterChoice, Gpu};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A signal this soon after the first one is a copy of it: a terminal, `timeout` or a scheduler may send it both to the
/// process and to its group.
const SAME_SIGNAL: Duration = Duration::from_secs(1);

/// Calls `first` at the first Ctrl-C, SIGTERM or closed terminal; a later one ends the program at once.
pub fn on_stop(first: impl Fn() + Send + 'static) {
    let mut stopping = None;
    // A process can have one handler only; an existing one (in tests) stays.
    let _ = ctrlc::set_handler(move || match stopping {
        None => {
            stopping = Some(Instant::now());
            first();
        }
        Some(begun) if begun.elapsed() > SAME_SIGNAL => end_now(),
        Some(_) => {}
    });
}

/// Ends the program without the cleanup of an orderly exit, in which drivers crash while other threads use them.
#[cfg(unix)]
fn end_now() {
    use rustix::process::{Signal, getpid, kill_process};
    let _ = kill_process(getpid(), Signal::KILL);
}

/// Ends the program.
#[cfg(not(unix))]
fn end_now() {
    std::process::exit(130);
}

/// Opens the adapter that `--adapter` names.
pub fn open_gpu(adapter: Option<&String>) -> Result<Arc<Gpu>> {
    let choice = adapter.map_or(AdapterChoice::Best, |name| AdapterChoice::Named(name.clone()));
    let gpu = Gpu::open(&choice)?;
    stderr!("adapter: {}", gpu.describe());
    Ok(gpu)
}
