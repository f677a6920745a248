//! `ibgs completions`

use crate::stdout;
use anyhow::Result;
use clap::{Args as ClapArgs, Command};
use clap_complete::Shell;

const EXAMPLES: &str = "\
Example:
  ibgs completions bash > ~/.local/share/bash-completion/completions/ibgs";

/// Options of `ibgs completions`.
#[derive(ClapArgs)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// Shell to print completions for.
    shell: Shell,
}

/// Prints completions of the program's command line.
pub fn run(args: &Args, mut program: Command) -> Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut program, "ibgs", &mut script);
    Ok(stdout::print(|out| out.write_all(&script))?)
}
