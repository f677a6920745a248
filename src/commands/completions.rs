//! `ibgs completions`

use crate::stdout;
use anyhow::Result;
use clap::{Args as ClapArgs, Command};
use clap_complete::Shell;

/// Options of `ibgs completions`.
#[derive(ClapArgs)]
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
