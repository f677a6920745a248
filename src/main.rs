//! `ibgs`: reconstruct a scene from posed photos and render new views of it.

#![forbid(unsafe_code)]

use clap::Parser;
use ibgs::{Cli, advice, stderr, terminal};
use std::process::ExitCode;

fn main() -> ExitCode {
    terminal::print_log();
    match Cli::parse().run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            stderr!("error: {}", advice::sentence(&error));
            ExitCode::FAILURE
        }
    }
}
