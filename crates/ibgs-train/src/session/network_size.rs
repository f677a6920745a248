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

/// The largest of 1, 0.5 and 0.25 of the image's size that is fast enough, for one that takes `whole` seconds at its own.
fn factor(whole: f64) -> f64 {
    [1.0, 0.5].into_iter().find(|factor| factor * factor * whole <= FRAME).unwrap_or(0.25)
}

/// Sets the size by a clock; none where it is the image's. It stays that on a software adapter, of which a frame is not expected in
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
    let pixels = size.iter().map(|&side| f64::from(side)).product::<f64>() * f64::from(residual.networks);
    let seconds = seconds_a_pixel(gpu, residual.precision, FRAME * OF_UNET / pixels.max(1.0))?;
    let whole = seconds * pixels / OF_UNET;
    let factor = factor(whole);
    if factor == 1.0 {
        return Ok(None);
    }
    config.residual.factor = Some(factor);
    Ok(Some(SmallNetwork { factor, size, whole }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slow_frame_has_a_smaller_network() {
        let factors = [0.0, 0.05, 0.051, 0.2, 0.21, 9.0, f64::INFINITY].map(factor);
        assert_eq!(factors, [1.0, 1.0, 0.5, 0.5, 0.25, 0.25, 0.25]);
    }
}
