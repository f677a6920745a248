//! `ibgs`: reconstruct a scene from posed photos and render new views of it.

#![deny(unsafe_code)]

use clap::Parser;
use ibgs::signals::{self, Stopped};
use ibgs::{Cli, advice, stderr, terminal};
use std::process::ExitCode;

fn main() -> ExitCode {
    quiet_layer();
    terminal::print_log();
    match Cli::parse().run() {
        Ok(()) => signals::exit_code().unwrap_or(ExitCode::SUCCESS),
        Err(error) if error.is::<Stopped>() => {
            stderr!("{error}");
            signals::exit_code().unwrap_or(ExitCode::FAILURE)
        }
        Err(error) => {
            stderr!("error: {}", advice::sentence(&error));
            ExitCode::FAILURE
        }
    }
}

/// Turns off Mesa's Vulkan layer that asks the desktop for its GPU, where there is no desktop: it would print an error
/// about that at every query of the adapters.
#[allow(unsafe_code)]
fn quiet_layer() {
    let is_set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    let desktop = ["XDG_RUNTIME_DIR", "WAYLAND_DISPLAY", "WAYLAND_SOCKET", "DISPLAY"];
    if cfg!(target_os = "linux") && !desktop.into_iter().any(is_set) {
        // SAFETY: nothing else runs in this process yet that could read the environment at the same time.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
}
