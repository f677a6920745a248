//! Lines on standard error. `eprintln!` panics once the pipe or terminal is closed (`ibgs train 2>&1 | head`), and a
//! training would end with it; [`stderr!`](crate::stderr) does not.

use std::fmt::Arguments;
use std::io::{Write, stderr};

/// A line on standard error, formatted like `eprintln!`; lost where the pipe or terminal is closed.
#[macro_export]
macro_rules! stderr {
    ($($part:tt)*) => { $crate::terminal::write_line(format_args!($($part)*)) };
}

/// What [`stderr!`](crate::stderr) does.
pub fn write_line(line: Arguments) {
    let _ = writeln!(stderr().lock(), "{line}");
}

/// Prints what the libraries log: warnings and notes.
struct Printer;

impl log::Log for Printer {
    fn enabled(&self, record: &log::Metadata) -> bool {
        // Our own; wgpu and its libraries log too much.
        record.level() <= log::Level::Info && record.target().starts_with("ibgs")
    }

    fn log(&self, record: &log::Record) {
        if self.enabled(record.metadata()) {
            match record.level() {
                log::Level::Error => stderr!("error: {}", record.args()),
                log::Level::Warn => stderr!("warning: {}", record.args()),
                _ => stderr!("note: {}", record.args()),
            }
        }
    }

    fn flush(&self) {}
}

/// Lets what the libraries log reach standard error.
pub fn print_log() {
    // Where there is a logger already, in tests, that one stays.
    if log::set_logger(&Printer).is_ok() {
        log::set_max_level(log::LevelFilter::Info);
    }
}
