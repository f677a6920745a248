//! Lines for whoever runs the program. `println!` and `eprintln!` panic once nobody reads them any more (`ibgs train 2>&1 |
//! head`, a terminal that was closed), and a training would end with them; these do not.

use std::fmt::Arguments;
use std::io::{ErrorKind, Result, Write, stderr, stdout};

/// A line on standard error, formatted like `eprintln!`; lost where nobody reads.
#[macro_export]
macro_rules! tell {
    ($($part:tt)*) => { $crate::terminal::tell(format_args!($($part)*)) };
}

/// A line on standard output, formatted like `println!`; see [`say`](crate::terminal::say).
#[macro_export]
macro_rules! say {
    () => { $crate::terminal::say(format_args!("")) };
    ($($part:tt)*) => { $crate::terminal::say(format_args!($($part)*)) };
}

/// What [`tell!`](crate::tell) does.
pub fn tell(line: Arguments) {
    let _ = writeln!(stderr().lock(), "{line}");
}

/// What [`say!`](crate::say) does: a line that nobody reads is lost; one that cannot be written (a full disk) is an error
/// that ends the program after a sentence, with exit code 1.
pub fn say(line: Arguments) {
    if let Err(error) = print(|out| writeln!(out, "{line}")) {
        tell(format_args!("error: cannot write to standard output: {error}"));
        std::process::exit(1);
    }
}

/// Writes to standard output; that nobody reads any more is no error.
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
