//! The size at which a training runs its network, where none is asked for: smaller than the image where that is too slow to look at.

use ibgs_core::config::{Method, TrainConfig};
use ibgs_core::dataset::Dataset;
use ibgs_core::gpu::{Gpu, GpuError};
use ibgs_core::residual::unet::choice::seconds_a_pixel;
use std::fmt;

/// Seconds that a frame may take.
const FRAME: f64 = 0.05;
/// Part of them that the U-Net takes on a GPU: 0.67 of 1.56 ms, 1.85 of 4.24.
const OF_UNET: f64 = 0.5;

/// A network that runs at less than the image's size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SmallNetwork {
    /// Its size, relative to the image's.
    pub factor: f64,
    /// Width and height of the largest training photo, in pixels.
    pub size: [u32; 2],
    /// Seconds of a frame of that size with the network at the image's size.
    pub whole: f64,
}

impl fmt::Display for SmallNetwork {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { factor, size: [width, height], whole } = self;
        write!(
            f,
            "note: the residual network runs at {factor} of the image's size; at the whole size a frame of {width} x {height} pixels would \
             take about {:.0} ms on this adapter",
            1e3 * whole
        )
    }
}

/// For images of a size and an adapter whose U-Net takes so long for a pixel: the largest of 1, 0.5 and 0.25 of the size that is fast
/// enough; none where the first is.
fn small_network(seconds_a_pixel: f64, size: [u32; 2], networks: u32) -> Option<SmallNetwork> {
    let pixels = f64::from(size[0]) * f64::from(size[1]);
    let whole = seconds_a_pixel * pixels * f64::from(networks) / OF_UNET;
    let is_fast = |factor: f64| factor * factor * whole <= FRAME;
    let factor = if is_fast(0.5) { 0.5 } else { 0.25 };
    (!is_fast(1.0)).then_some(SmallNetwork { factor, size, whole })
}

/// Sets the size by a clock; none where it stays the image's. It stays that on a software adapter, of which a frame is not expected in
/// that time, in a deterministic training, and for a network that has been trained before.
///
/// # Errors
/// Not enough memory, or the device is lost.
pub fn choose(gpu: &Gpu, dataset: &Dataset, config: &mut TrainConfig) -> Result<Option<SmallNetwork>, GpuError> {
    let residual = &config.residual;
    let is_given = residual.factor.is_some() || residual.init.is_some() || config.method != Method::Ibgs;
    if is_given || config.deterministic || gpu.is_software() {
        return Ok(None);
    }
    let sizes =
        dataset.train.iter().map(|&view| dataset.views[view].camera).map(|camera| [camera.width, camera.height]);
    let size = sizes.max_by_key(|[width, height]| u64::from(*width) * u64::from(*height)).unwrap_or_default();
    let pixels = f64::from(size[0]) * f64::from(size[1]) * f64::from(residual.networks);
    let seconds = seconds_a_pixel(gpu, residual.precision, FRAME * OF_UNET / pixels.max(1.0))?;
    let small = small_network(seconds, size, residual.networks);
    if let Some(network) = &small {
        config.residual.factor = Some(network.factor);
    }
    Ok(small)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slow_frame_has_a_smaller_network() {
        // The time of an NVIDIA H100 on matrix units; a tenth and a hundredth of its speed.
        let [fast, medium, slow] = [1.0, 10.0, 100.0].map(|times| times * 1.3e-9);
        let factor = |seconds, size, networks| small_network(seconds, size, networks).map(|network| network.factor);
        let (small, large) = ([640, 480], [1600, 1064]);
        assert_eq!([fast, medium, slow].map(|seconds| factor(seconds, small, 1)), [None, None, Some(0.5)]);
        assert_eq!([fast, medium, slow].map(|seconds| factor(seconds, large, 1)), [None, None, Some(0.25)]);
        assert_eq!([medium, slow].map(|seconds| factor(seconds, large, 2)), [Some(0.5), Some(0.25)]);
        // Exactly fast enough.
        let limits = [0.025, 0.0251, 0.1, 0.101].map(|seconds| factor(seconds, [1, 1], 1));
        assert_eq!(limits, [None, Some(0.5), Some(0.5), Some(0.25)]);
        let whole = small_network(slow, large, 1).unwrap().whole;
        assert!((whole - 2.0 * 1.3e-7 * 1600.0 * 1064.0).abs() < 1e-6, "{whole}");
    }
}
