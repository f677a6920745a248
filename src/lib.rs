//! The commands of the `ibgs` program.

#![forbid(unsafe_code)]

pub mod commands;
pub mod stdout;
pub mod version;
