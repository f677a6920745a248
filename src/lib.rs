//! The commands of the `ibgs` program.

pub mod commands;
