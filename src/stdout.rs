//! What commands print. `println!` panics once the pipe is closed (`ibgs info | head`); [`stdout!`](crate::stdout!) does not.

use crate::stderr;
use std::fmt::Arguments;
use std::io::{ErrorKind, Result, Write, stdout};

/// A line on standard output, formatted like `println!`; see [`write_line`].
#[macro_export]
macro_rules! stdout {
    () => { $crate::stdout::write_line(format_args!("")) };
    ($($part:tt)*) => { $crate::stdout::write_line(format_args!($($part)*)) };
}

/// What [`stdout!`](crate::stdout!) does: a line for a closed pipe is lost; one that cannot be written (a full disk) ends the program
/// with a sentence and exit code 1.
pub fn write_line(line: Arguments) {
    if let Err(error) = print(|out| writeln!(out, "{line}")) {
        stderr!("error: cannot write to standard output: {error}");
        std::process::exit(1);
    }
}

/// Writes to standard output; a closed pipe is no error.
///
/// # Errors
/// It cannot be written, for instance to a full disk.
pub fn print(write: impl FnOnce(&mut dyn Write) -> Result<()>) -> Result<()> {
    let mut out = stdout().lock();
    match write(&mut out).and_then(|()| out.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        outcome => outcome,
    }
}
