//! Training: configuration, schedule, the loop body, densification, output folder.

mod background;
pub mod checkpoint;
pub mod config;
pub mod densify;
mod exposing;
mod filter;
pub mod optim;
pub mod output;
pub mod schedule;
mod stages;
mod step;
mod telemetry;

pub use step::{TrainError, Trainer};
pub use telemetry::Telemetry;
