//! A benchmark: stages by GPU timestamps, frames and iterations by the clock, each beside the floor that the
//! device's own rates give it.
//!
//! [`rates`] measures how fast the device moves memory and computes. [`scene`] makes a view to measure, of a model or
//! of random Gaussians, with neighbours whose photos are the model's own pictures. [`measure`](measure()) runs the five
//! kinds of [`stage::Work`] on it. [`floor`] says how much each [`stage::Stage`] has to do at least. [`report`] holds
//! the results.

pub mod floor;
mod measure;
pub mod rates;
pub mod report;
pub mod scene;
pub mod stage;

pub use measure::measure;
pub use rates::Rates;
pub use report::{Configuration, DeviceReport, Report, StageTiming, Timing};
pub use scene::{Setting, synthetic};
pub use stage::{Stage, Work};

/// Fewest runs that a median is of.
pub const LEAST_RUNS: u32 = 5;

/// The middle value, or the mean of the two in the middle; 0 of none.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    match values.len() {
        0 => 0.0,
        count if count.is_multiple_of(2) => (values[count / 2 - 1] + values[count / 2]) / 2.0,
        count => values[count / 2],
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_median_is_in_the_middle() {
        assert_eq!(super::median(vec![]), 0.0);
        assert_eq!(super::median(vec![3.0, 1.0, 100.0]), 3.0);
        assert_eq!(super::median(vec![4.0, 1.0, 2.0, 100.0]), 3.0);
    }
}
