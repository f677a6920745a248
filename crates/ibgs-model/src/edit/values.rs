//! Values of the Gaussians by which they are selected: in a range, with a histogram to choose it by.

use super::{Mask, place};
use crate::camera::Camera;
use crate::scene::Gaussians;
use glam::DVec3;
use rayon::prelude::*;

/// Bars of a histogram.
const BARS: usize = 64;

/// A value that every Gaussian has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Value {
    /// Its opacity, 0 to 1.
    Opacity,
    /// Its largest standard deviation in scene units.
    Size,
    /// Its distance from the middle of the cameras in scene units.
    Distance,
    /// Number of photos within whose frame its centre lies, hidden there or not.
    Photos,
}

impl Value {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Opacity, Self::Size, Self::Distance, Self::Photos];

    /// Whether values of several orders of magnitude are told apart.
    pub fn is_logarithmic(self) -> bool {
        matches!(self, Self::Size | Self::Distance)
    }

    /// The value of every Gaussian. `middle` is where distances begin, `cameras` are those of the photos.
    pub fn of(self, gaussians: &Gaussians, middle: DVec3, cameras: &[Camera]) -> Vec<f32> {
        let value = |i: usize| match self {
            Self::Opacity => opacity(gaussians, i),
            Self::Size => {
                let [x, y, z] = gaussians.log_scales[i].map(f64::from);
                x.max(y).max(z).exp() * gaussians.space.scale
            }
            Self::Distance => place(gaussians, i).distance(middle),
            Self::Photos => {
                let place = place(gaussians, i);
                cameras.iter().filter(|camera| camera.seen(place).is_some()).count() as f64
            }
        };
        (0..gaussians.len()).into_par_iter().map(|i| value(i) as f32).collect()
    }
}

/// Opacity of a Gaussian, 0 to 1.
pub(super) fn opacity(gaussians: &Gaussians, index: usize) -> f64 {
    1.0 / (1.0 + (-f64::from(gaussians.opacity_logits[index])).exp())
}

/// The Gaussians with a value in a range, its ends included.
pub fn in_range(values: &[f32], [low, high]: [f32; 2]) -> Mask {
    Mask::of(values.len(), |i| (low..=high).contains(&values[i]))
}

/// How often values occur.
#[derive(Clone, Debug, PartialEq)]
pub struct Histogram {
    /// Smallest and largest value.
    pub ends: [f32; 2],
    /// Numbers of values in bars of one width, by logarithms where so asked for.
    pub bars: Vec<u32>,
    is_logarithmic: bool,
}

impl Histogram {
    /// The histogram of the finite values of a mask; none where it has none. With logarithms values of 0 count as the smallest
    /// other one.
    pub fn of(values: &[f32], among: &Mask, is_logarithmic: bool) -> Option<Self> {
        let least = if is_logarithmic { f32::MIN_POSITIVE } else { f32::MIN };
        let counted = || among.iter().map(|i| values[i]).filter(|value| value.is_finite() && *value >= least);
        let low = counted().min_by(f32::total_cmp)?;
        let high = counted().max_by(f32::total_cmp)?;
        let mut histogram = Self { ends: [low, high], bars: vec![0; BARS], is_logarithmic };
        for value in among.iter().map(|i| values[i]).filter(|value| value.is_finite()) {
            let bar = (histogram.share(value) * BARS as f32) as usize;
            histogram.bars[bar.min(BARS - 1)] += 1;
        }
        Some(histogram)
    }

    /// Where a value lies between the ends, 0 to 1.
    pub fn share(&self, value: f32) -> f32 {
        let [low, high, value] = [self.ends[0], self.ends[1], value].map(|value| self.scaled(value));
        if high > low { ((value - low) / (high - low)).clamp(0.0, 1.0) } else { 0.5 }
    }

    /// The value that lies there.
    pub fn value(&self, share: f32) -> f32 {
        // The ends themselves, without rounding.
        if share <= 0.0 {
            return self.ends[0];
        }
        if share >= 1.0 {
            return self.ends[1];
        }
        let [low, high] = self.ends.map(|value| self.scaled(value));
        let value = low + share * (high - low);
        if self.is_logarithmic { value.exp() } else { value }
    }

    fn scaled(&self, value: f32) -> f32 {
        if self.is_logarithmic { value.max(f32::MIN_POSITIVE).ln() } else { value }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{camera, grid};
    use super::*;

    #[test]
    fn ranges_of_values_are_found() {
        let gaussians = grid();
        let all = gaussians.len();
        let of = |value: Value| value.of(&gaussians, DVec3::ZERO, &[camera(), Camera { width: 1, ..camera() }]);
        let count = |value: Value, low: f32, high: f32| in_range(&of(value), [low, high]).count();
        // Logits from -8.55 on by 0.05: those below 0 have less than half.
        assert_eq!(count(Value::Opacity, 0.0, 0.4999), 171);
        assert_eq!(count(Value::Opacity, 0.0, 1.0), all);
        // In scene units every standard deviation is twice that of the file.
        assert_eq!(count(Value::Size, 2.0 * 0.01 * 300.5, f32::MAX), all - 300);
        assert_eq!(count(Value::Distance, 5.0, f32::MAX), 8, "the corners");
        assert_eq!(count(Value::Distance, 0.0, 1.0), 7);
        // The first camera sees all that is no more than 40 pixels above or below its middle; the second one only a column of
        // pixels at the left, where nothing is.
        let seen = |i: &usize| {
            let place = place(&gaussians, *i);
            (100.0 * place.y / (place.z + 10.0)).abs() < 40.0 && (100.0 * place.x / (place.z + 10.0)).abs() < 50.0
        };
        let seen = (0..all).filter(seen).count();
        assert!(seen > 300 && seen < all);
        assert_eq!((count(Value::Photos, 1.0, 1.0), count(Value::Photos, 0.0, 0.0)), (seen, all - seen));
    }

    #[test]
    fn histograms_count_every_value_once() {
        let values = [0.0, 0.001, 0.1, 1.0, 10.0, 1000.0, f32::INFINITY, f32::NAN, 5000.0];
        let among = Mask::of(values.len(), |i| i < 8);
        for is_logarithmic in [false, true] {
            let histogram = Histogram::of(&values, &among, is_logarithmic).unwrap();
            assert_eq!(histogram.bars.iter().sum::<u32>(), 6);
            assert_eq!(histogram.ends, [if is_logarithmic { 0.001 } else { 0.0 }, 1000.0]);
            for value in [0.1, 1.0, 10.0, 1000.0] {
                let back = histogram.value(histogram.share(value));
                assert!((back - value).abs() < 1e-3 * value.max(0.1), "{value} {back}");
            }
            assert_eq!((histogram.value(0.0), histogram.value(1.0)), (histogram.ends[0], 1000.0));
        }
        let logarithmic = Histogram::of(&values, &among, true).unwrap();
        assert!((logarithmic.share(1.0) - 0.5).abs() < 1e-5);
        assert_eq!((logarithmic.bars[0], logarithmic.bars[BARS / 2], logarithmic.bars[BARS - 1]), (2, 1, 1));
        // All alike, and none.
        let alike = Histogram::of(&[2.0; 5], &Mask::all(5), true).unwrap();
        assert_eq!((alike.ends, alike.bars.iter().sum::<u32>()), ([2.0; 2], 5));
        assert_eq!(Histogram::of(&[1.0], &Mask::none(1), false), None);
        assert_eq!(Histogram::of(&[f32::NAN], &Mask::all(1), false), None);
    }
}
