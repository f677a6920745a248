//! `ibgs man`

use crate::stdout;
use anyhow::Result;
use clap::{Args as ClapArgs, Command};
use clap_mangen::Man;
use ibgs_core::files::write_atomically;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Example:
  ibgs man ~/.local/share/man/man1";

/// Options of `ibgs man`.
#[derive(ClapArgs)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// Folder for the pages of the program and of every command [default: print the program's page].
    folder: Option<PathBuf>,
}

/// Writes the manual pages of the program's command line.
pub fn run(args: &Args, program: Command) -> Result<()> {
    // The `help` subcommands need no pages.
    let mut program = program.disable_help_subcommand(true);
    program.build();
    match &args.folder {
        Some(folder) => write(&program, folder),
        None => Ok(stdout::print(|mut out| Man::new(program).render(&mut out))?),
    }
}

fn write(command: &Command, folder: &Path) -> Result<()> {
    let page = Man::new(command.clone());
    write_atomically(&folder.join(page.get_filename()), |mut out| page.render(&mut out))?;
    command.get_subcommands().try_for_each(|command| write(command, folder))
}
