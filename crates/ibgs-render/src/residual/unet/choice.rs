//! Whether the matrix units are right and fast on this adapter, by a test against the portable path when they are first wanted, and
//! how long the U-Net takes.

use super::{Arithmetic, UNet};
use crate::gpu::{Buffer, Gpu, GpuError, Pass};
use crate::raster::Keep;
use crate::residual::layers::{self, INPUT, WEIGHTS};
use crate::residual::variant::Precision;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::time::{Duration, Instant};

/// Size at which the two paths are compared; odd, so that every border is met.
const COMPARED: [u32; 2] = [75, 53];
/// Size at which they are timed.
const TIMED: [u32; 2] = [640, 480];
/// Passes that are timed, of which the fastest counts; the first is slow and does not.
const PASSES: usize = 4;
/// Once they have taken so long, there are no more.
const LONG: Duration = Duration::from_millis(500);
/// Largest difference that counts as right, as a part of the largest value.
pub const TOLERANCE: f32 = 1e-4;

/// A network and maps that halves hold without any rounding through all layers: small whole numbers, few weights an output, in
/// the last layers more, so that every layer has a gradient.
#[derive(Clone, Debug)]
pub struct WholeNumbers {
    /// The network's flat weights.
    pub weights: Vec<f32>,
    /// `[38][height * width]`.
    pub planes: Vec<f32>,
    /// `[height * width * 4]`; of the size that a mean over all values gives.
    pub v_residual: Vec<f32>,
}

impl WholeNumbers {
    /// For an image of `width` x `height` pixels.
    pub fn new(width: u32, height: u32, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut weights = vec![0.0; WEIGHTS];
        for layer in layers::UNET {
            let last = [layers::FINAL.name, layers::FUSE.name, layers::DEC1.name].contains(&layer.name);
            let length = layer.inputs * layer.taps;
            for o in 0..layer.outputs {
                for _ in 0..if last { 6 } else { 2 } {
                    let at = layer.offset + o * length + rng.random_range(0..length);
                    weights[at] = if rng.random() { 1.0 } else { -1.0 };
                }
                weights[layer.bias() + o] = rng.random_range(0..3u8).into();
            }
        }
        let pixels = width as usize * height as usize;
        let unit = ((3 * pixels).next_power_of_two() as f32).recip();
        let mut values =
            |count: usize, most: i8| (0..count).map(|_| f32::from(rng.random_range(-most..=most))).collect::<Vec<_>>();
        let planes = values(INPUT * pixels, 3);
        let v_residual = values(layers::OUTPUTS * pixels, 1).iter().map(|v| v * unit).collect();
        Self { weights, planes, v_residual }
    }
}

/// What a path makes of them: residual, gradient by the planes, gradient by the weights.
type Results = [Vec<f32>; 3];

/// A path with whole numbers to work on.
struct Trial<'a> {
    gpu: &'a Gpu,
    unet: UNet,
    pixels: usize,
    weights: Buffer<f32>,
    v_residual: Buffer<[f32; 4]>,
    v_weights: Buffer<f32>,
}

impl<'a> Trial<'a> {
    fn new(gpu: &'a Gpu, size: [u32; 2], keep: Keep, arithmetic: Arithmetic) -> Result<Self, GpuError> {
        let numbers = WholeNumbers::new(size[0], size[1], 0);
        let unet = UNet::new(gpu, size, keep, arithmetic)?;
        unet.write_input(gpu, &numbers.planes);
        Ok(Self {
            gpu,
            unet,
            pixels: (size[0] * size[1]) as usize,
            weights: gpu.upload("weights", &numbers.weights)?,
            v_residual: gpu.upload("v_residual", numbers.v_residual.as_chunks().0)?,
            v_weights: gpu.upload("v_weights", &vec![0.0f32; WEIGHTS])?,
        })
    }

    /// Forward and, where gradients are kept, backward, and the time of both.
    fn pass(&self) -> Result<Duration, GpuError> {
        self.gpu.queue.submit([]);
        self.gpu.wait()?;
        let start = Instant::now();
        let mut pass = Pass::new(self.gpu, "self-test");
        self.unet.forward(&mut pass, &self.weights);
        if self.unet.has_gradients() {
            self.unet.backward(&mut pass, &self.weights, &self.v_residual, &self.v_weights);
        }
        pass.submit();
        self.gpu.wait()?;
        Ok(start.elapsed())
    }

    /// The time of the fastest pass.
    fn fastest(&self) -> Result<Duration, GpuError> {
        self.pass()?;
        let start = Instant::now();
        let mut fastest = self.pass()?;
        for _ in 2..PASSES {
            if start.elapsed() < LONG {
                fastest = fastest.min(self.pass()?);
            }
        }
        Ok(fastest)
    }

    fn results(&self) -> Result<Results, GpuError> {
        Ok([
            self.gpu.read(self.unet.residual(), self.pixels)?.into_flattened(),
            self.unet.read_v_x(self.gpu)?,
            self.gpu.read(&self.v_weights, WEIGHTS)?,
        ])
    }
}

/// Largest difference, as a part of the largest value.
fn difference(a: &[f32], b: &[f32]) -> f32 {
    let largest = b.iter().fold(0.0f32, |m, v| m.max(v.abs()));
    let apart = a.iter().zip(b).map(|(a, b)| (a - b).abs());
    // NaN must not compare as small.
    let apart = apart.fold(0.0f32, |m, v| if v.is_nan() { f32::INFINITY } else { m.max(v) });
    // Files of results hold no infinity.
    if apart == 0.0 { 0.0 } else { (apart / largest).min(f32::MAX) }
}

/// What the network computes with at this precision.
pub(in crate::residual) fn arithmetic(gpu: &Gpu, precision: Precision) -> Arithmetic {
    match precision {
        Precision::Auto if pays(gpu) => Arithmetic::Half,
        Precision::Auto => Arithmetic::Packed,
        Precision::Full => Arithmetic::Full,
    }
}

/// Whether the matrix units give the portable path's results, and sooner. Runs once for each [`Gpu`]; false on software
/// adapters, whose matrix units save nothing.
pub fn pays(gpu: &Gpu) -> bool {
    let test = || {
        if gpu.is_software() || gpu.matrix_units.is_none() {
            return Ok(false);
        }
        match gpu.tested("matrix-units", || error(gpu))? {
            Some(error) if error > TOLERANCE => {
                log::warn!("the matrix units of {} are wrong by {error:.1e} and are not used", gpu.info.name);
                Ok(false)
            }
            Some(_) => gpu.tested("matrix-units-faster", || faster(gpu)),
            None => Ok(false),
        }
    };
    *gpu.matrix_units_pay.get_or_init(|| {
        test().unwrap_or_else(|error: GpuError| {
            log::warn!("the matrix units could not be tested and are not used: {error}");
            false
        })
    })
}

/// By how much the matrix units' results differ from the portable path's where no value needs rounding, as a part of the
/// largest value; none without matrix units.
///
/// # Errors
/// Not enough memory, or the device is lost.
pub fn error(gpu: &Gpu) -> Result<Option<f32>, GpuError> {
    if gpu.matrix_units.is_none() {
        return Ok(None);
    }
    let trial = |arithmetic| Trial::new(gpu, COMPARED, Keep::Gradients, arithmetic);
    let (half, full) = (trial(Arithmetic::Half)?, trial(Arithmetic::Full)?);
    // Twice over: the second pass must not see anything of the first.
    half.pass()?;
    half.pass()?;
    full.pass()?;
    let (half, full) = (half.results()?, full.results()?);
    Ok(Some(half.iter().zip(&full).map(|(a, b)| difference(a, b)).fold(0.0, f32::max)))
}

fn faster(gpu: &Gpu) -> Result<bool, GpuError> {
    let fastest = |arithmetic| Trial::new(gpu, TIMED, Keep::Gradients, arithmetic)?.fastest();
    Ok(fastest(Arithmetic::Half)? < fastest(Arithmetic::Full)?)
}

/// Seconds that the U-Net takes for each pixel of an image, by the arithmetic that it has at this precision. No more than `enough`
/// need not be measured again at each start.
///
/// # Errors
/// Not enough memory, or the device is lost.
pub fn seconds_a_pixel(gpu: &Gpu, precision: Precision, enough: f64) -> Result<f64, GpuError> {
    let arithmetic = arithmetic(gpu, precision);
    let name = match arithmetic {
        Arithmetic::Full => "unet",
        Arithmetic::Packed => "unet-of-packed-halves",
        Arithmetic::Half => "unet-on-matrix-units",
    };
    let pixels = f64::from(TIMED[0] * TIMED[1]);
    let enough = Duration::from_secs_f64(enough * pixels);
    let time = gpu.time(name, enough, || Trial::new(gpu, TIMED, Keep::Image, arithmetic)?.fastest())?;
    Ok(time.as_secs_f64() / pixels)
}
