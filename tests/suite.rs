//! The integration tests of ibgs: one binary.
#![allow(missing_docs, clippy::print_stderr, clippy::print_stdout, clippy::too_many_lines)]
#![forbid(unsafe_code)]

mod bad_input_random;
mod cli;
mod config_reference;
#[path = "../crates/ibgs-train/tests/lpips_network.rs"]
mod lpips_network;
#[path = "../crates/ibgs-train/tests/small.rs"]
mod small;
mod viewer;
