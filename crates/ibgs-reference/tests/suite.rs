//! Holds the CPU twins to finite differences, where they do not themselves, to the golden data and to independent evaluations.
#![allow(missing_docs, clippy::print_stdout)]
#![forbid(unsafe_code)]

mod cameras;
mod geometry;
mod golden;
mod gradients;
mod losses;
mod thresholds;
