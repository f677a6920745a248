//! `ibgs`: reconstruct a scene from posed photos and render new views of it.

#![forbid(unsafe_code)]

use clap::{CommandFactory, Parser, Subcommand};
use ibgs::tell;
use ibgs::{commands, version};
use std::process::ExitCode;

/// Reconstruct a scene from posed photos and render new views with Gaussian splatting, on any GPU with Vulkan, Metal
/// or DX12.
#[derive(Parser)]
#[command(name = "ibgs", version = version::SHORT, long_version = version::long(), max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Train a model on a scene folder, or on the built-in demo scene.
    Train(Box<commands::train::Args>),
    /// Render views of a trained model to pictures.
    Render(commands::render::Args),
    /// Measure a trained model on its held-out views.
    Eval(commands::eval::Args),
    /// Put the figures of several models beside each other.
    Compare(commands::compare::Args),
    /// Train and measure all scenes of a benchmark or all runs of a study.
    Suite(commands::suite::Args),
    /// Look at a trained model in a window.
    View(commands::view::Args),
    /// Make a triangle mesh of a trained model, and measure it.
    Mesh(Box<commands::mesh::Args>),
    /// Write a trained model as one file.
    Export(commands::export::Args),
    /// Say what a scene, a model or a PLY file holds; without a path: the adapters of this machine.
    Info(commands::info::Args),
    /// Time every stage on this machine.
    Bench(commands::bench::Args),
    /// Print completions for a shell.
    Completions(commands::completions::Args),
    /// Write manual pages.
    Man(commands::man::Args),
}

fn main() -> ExitCode {
    ibgs::terminal::print_log();
    let result = match Cli::parse().command {
        Command::Train(args) => commands::train::run(&args),
        Command::Render(args) => commands::render::run(&args),
        Command::Eval(args) => commands::eval::run(&args),
        Command::Compare(args) => commands::compare::run(&args),
        Command::Suite(args) => commands::suite::run(&args),
        Command::View(args) => commands::view::run(&args),
        Command::Mesh(args) => commands::mesh::run(&args),
        Command::Export(args) => commands::export::run(&args),
        Command::Info(args) => commands::info::run(&args),
        Command::Bench(args) => commands::bench::run(&args),
        Command::Completions(args) => commands::completions::run(&args, Cli::command()),
        Command::Man(args) => commands::man::run(&args, Cli::command()),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            tell!("error: {}", ibgs_viewer::worker::sentence(&error));
            ExitCode::FAILURE
        }
    }
}
