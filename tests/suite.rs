//! The integration tests of ibgs: one binary.
#![allow(missing_docs, clippy::print_stderr, clippy::print_stdout)]
#![forbid(unsafe_code)]

mod bad_input;
mod bad_input_csv;
mod bad_input_json;
mod bad_input_random;
mod browser_limits;
mod cli;
mod common;
mod dataset;
mod dataset_photos;
mod dataset_real;
mod demo;
mod gradients;
mod inspect;
mod kernels;
mod lpips;
mod reference;
mod reference_checks;
mod scene;
mod scene_files;
mod sources;
mod subgroups;
mod train_smoke;
mod viewer;
