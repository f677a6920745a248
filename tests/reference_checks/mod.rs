//! Holds the CPU twins to finite differences, to the golden data and to independent evaluations.

mod geometry;
mod golden;
mod gradients;
mod losses;
mod surface_losses;
mod thresholds;
