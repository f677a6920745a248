//! The commands of the `ibgs` program.

#![forbid(unsafe_code)]

pub mod commands;
pub mod progress;
pub mod stdout;
pub mod terminal;
pub mod version;
