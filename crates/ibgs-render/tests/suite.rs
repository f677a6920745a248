//! The tests of the passes on the GPU: one binary. They need an adapter; a software one will do.
#![allow(missing_docs, clippy::print_stderr, clippy::print_stdout, clippy::too_many_lines)]
#![forbid(unsafe_code)]

mod formats;
mod kernels;
mod photo_errors;
mod removed;
mod source_store;
mod subgroups;
mod window_errors;
