//! The `ibgs` program: parses the command line, calls the libraries, prints.

#![forbid(unsafe_code)]

pub mod advice;
pub mod commands;
pub mod prepare;
pub mod progress;
pub mod signals;
pub mod stdout;
pub mod terminal;
pub mod version;

use anyhow::Result;
use clap::{CommandFactory, Parser, Subcommand};

/// Reconstruct a scene from posed photos and render new views with Gaussian splatting, on any GPU with Vulkan, Metal
/// or DX12.
#[derive(Parser)]
#[command(name = "ibgs", version = version::SHORT, long_version = version::long(), max_term_width = 100)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Estimate the camera poses of photos or a video with COLMAP: from them to a scene to train on.
    Prepare(commands::prepare::Args),
    /// Train a model on a scene folder, or on the built-in demo scene.
    Train(Box<commands::train::Args>),
    /// Render views of a trained model to pictures.
    Render(commands::render::Args),
    /// Measure a trained model on its held-out views.
    Eval(commands::eval::Args),
    /// Compare the figures of several models.
    Compare(commands::compare::Args),
    /// Train and measure all scenes of a benchmark or all runs of a study.
    Suite(commands::suite::Args),
    /// Cut a scene into blocks that are trained apart, on less memory or on several GPUs.
    Split(commands::split::Args),
    /// Merge the trained blocks of a scene into one model.
    Merge(commands::merge::Args),
    /// Look at a trained model in a window.
    View(commands::view::Args),
    /// Make a triangle mesh of a trained model, and measure it.
    Mesh(Box<commands::mesh::Args>),
    /// Write a trained model as one file, or as a folder for a browser.
    Export(commands::export::Args),
    /// Show a folder of `ibgs export --web` to browsers.
    Serve(commands::serve::Args),
    /// Show what a scene, a model or a file of Gaussians holds; without a path: the adapters of this machine.
    Info(commands::info::Args),
    /// Time every stage on this machine.
    Bench(commands::bench::Args),
    /// Print completions for a shell.
    Completions(commands::completions::Args),
    /// Write manual pages.
    Man(commands::man::Args),
}

impl Cli {
    /// Runs the command.
    ///
    /// # Errors
    /// What went wrong, in a sentence.
    pub fn run(self) -> Result<()> {
        match self.command {
            Command::Prepare(args) => commands::prepare::run(&args),
            Command::Train(args) => commands::train::run(&args),
            Command::Render(args) => commands::render::run(&args),
            Command::Eval(args) => commands::eval::run(&args),
            Command::Compare(args) => commands::compare::run(&args),
            Command::Suite(args) => commands::suite::run(&args),
            Command::Split(args) => commands::split::run(&args),
            Command::Merge(args) => commands::merge::run(&args),
            Command::View(args) => commands::view::run(&args),
            Command::Mesh(args) => commands::mesh::run(&args),
            Command::Export(args) => commands::export::run(&args),
            Command::Serve(args) => commands::serve::run(&args),
            Command::Info(args) => commands::info::run(&args),
            Command::Bench(args) => commands::bench::run(&args),
            Command::Completions(args) => commands::completions::run(&args, Self::command()),
            Command::Man(args) => commands::man::run(&args, Self::command()),
        }
    }
}
