//! The tests of what ibgs reads and writes: one binary, no GPU.
#![allow(missing_docs, clippy::print_stderr, clippy::print_stdout)]
#![forbid(unsafe_code)]

mod bad_input;
mod bad_input_csv;
mod bad_input_json;
mod dataset;
mod dataset_photos;
mod dataset_real;
mod matching;
mod scene;
