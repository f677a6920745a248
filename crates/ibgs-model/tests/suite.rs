//! The tests of models and their folders: one binary.
#![allow(missing_docs, clippy::print_stderr, clippy::print_stdout)]
#![forbid(unsafe_code)]

mod bundle;
mod ensemble;
mod find;
mod levels;
mod output;
