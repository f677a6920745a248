//! The tests of training: one binary. They need an adapter; a software one will do.
#![allow(missing_docs, clippy::print_stderr, clippy::print_stdout, clippy::too_many_lines)]
#![forbid(unsafe_code)]

mod begin;
mod browser_limits;
mod common;
mod gradients;
mod inspect;
mod kernels;
mod lpips;
mod lpips_network;
mod small;
mod train_smoke;
