//! Lines for whoever runs the program. `eprintln!` panics once nobody reads any more (`ibgs train 2>&1 | head`, a terminal that
//! was closed), and a training would end with it; [`tell!`](crate::tell) does not.

use std::fmt::Arguments;
use std::io::{Write, stderr};

/// A line on standard error, formatted like `eprintln!`; lost where nobody reads.
#[macro_export]
macro_rules! tell {
    ($($part:tt)*) => { $crate::terminal::tell(format_args!($($part)*)) };
}

/// What [`tell!`](crate::tell) does.
pub fn tell(line: Arguments) {
    let _ = writeln!(stderr().lock(), "{line}");
}
