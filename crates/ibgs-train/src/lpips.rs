//! LPIPS with VGG16: the distance of two images in the features of a network (method.md section 9).
//!
//! Arithmetic and weights are those of the public `lpips` package, version 0.1: the images are shifted and scaled, the
//! features after the last ReLU of each of VGG16's five blocks are normalised over their channels, their squared
//! differences are weighted by channel, averaged over pixels and summed over blocks.

mod weights;

pub use weights::{LpipsError, LpipsWeights};

use crate::tensor;
use burn::tensor::activation::relu;
use burn::tensor::module::{conv2d, max_pool2d};
use burn::tensor::ops::{ConvOptions, MaxPoolOptions};
use burn::tensor::{Device, Tensor, TensorData};
use ibgs_core::dataset::Photo;
use ibgs_core::eval::{EvalError, Pair, Perceptual};
use ibgs_core::gpu::{Gpu, GpuError};
use ibgs_core::render::Rendered;
use std::ops::Range;
use std::sync::Arc;
use weights::BLOCKS;

/// What the package subtracts from red, green and blue in -1..1.
const SHIFT: [f32; 3] = [-0.030, -0.088, -0.188];
/// What it divides them by then.
const SCALE: [f32; 3] = [0.458, 0.448, 0.450];
/// Added to the length of a pixel's features before they are divided by it.
const EPSILON: f32 = 1e-10;
/// Pixels of the image along one side of a feature of the last block.
const CELL: usize = 16;
/// Rows beyond a band that its features depend on: 90, in whole cells.
const HALO: usize = 6 * CELL;
/// Most bytes of one layer's features at once; an image with more is worked on in bands of rows.
pub const BAND_BYTES: u64 = 512 << 20;

/// How the values of an image reach the network.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum InputRange {
    /// From 0..1 to -1..1, as the package asks for.
    #[default]
    Signed,
    /// As they are, 0..1: as in published figures of Gaussian splatting.
    Published,
}

impl InputRange {
    /// For the protocol beside the figures.
    pub fn describe(self) -> &'static str {
        match self {
            Self::Signed => "VGG16, images mapped to -1..1",
            Self::Published => "VGG16, images left in 0..1 as in published figures",
        }
    }

    fn map(self, value: f32) -> f32 {
        match self {
            Self::Signed => 2.0 * value - 1.0,
            Self::Published => value,
        }
    }
}

/// A 3 x 3 convolution on the device.
struct Layer {
    /// `[outputs, inputs, 3, 3]`.
    weight: Tensor<4>,
    /// `[outputs]`.
    bias: Tensor<1>,
}

/// The network on the device.
pub struct Lpips {
    gpu: Arc<Gpu>,
    device: Device,
    /// The layers of each block.
    blocks: Vec<Vec<Layer>>,
    /// Weights of each block's channels, `[1, channels, 1, 1]`.
    linear: Vec<Tensor<4>>,
    range: InputRange,
    most_bytes: u64,
}

impl Perceptual for Lpips {
    fn distance(&self, image: &Rendered, photo: &Photo) -> Result<f64, EvalError> {
        self.distance(image, photo).map_err(|error| match error {
            LpipsError::Gpu(error) => error.into(),
            error => EvalError::Distance(Box::new(error)),
        })
    }
}

impl Lpips {
    /// Distance of an image rounded to 8 bits from a photo of the same size; 0 for equal ones. Pixels whose alpha is
    /// under one half do not count: the photo takes the image's value there.
    ///
    /// # Errors
    /// An image under 16 x 16 pixels, or so wide that a band of it does not fit; a lost device.
    ///
    /// # Panics
    /// When the sizes differ: a bug of ours.
    pub fn distance(&self, image: &Rendered, photo: &Photo) -> Result<f64, LpipsError> {
        let pair = Pair::new(image, photo);
        let [width, height] = [image.width as usize, image.height as usize];
        if width < CELL || height < CELL {
            return Err(LpipsError::TooSmall { width: image.width, height: image.height });
        }
        let mut sums = [0.0; BLOCKS];
        for own in self.bands(width, height)? {
            for (sum, part) in sums.iter_mut().zip(self.band(&pair, [width, height], own)?) {
                *sum += part;
            }
        }
        let pixels = |block: usize| ((width >> block) * (height >> block)) as f64;
        Ok(sums.iter().enumerate().map(|(block, sum)| sum / pixels(block)).sum())
    }

    /// Puts the weights on the device. One layer's features take at most `most_bytes` ([`BAND_BYTES`] is a good
    /// choice) and no more than the device binds at once; the result does not depend on it.
    ///
    /// # Errors
    /// burn refuses the device.
    pub fn new(gpu: Arc<Gpu>, weights: &LpipsWeights, range: InputRange, most_bytes: u64) -> Result<Self, GpuError> {
        let device = tensor::device(&gpu)?.clone();
        let layer = |l: &weights::Layer| Layer {
            weight: Tensor::from_data(TensorData::new(l.weight.clone(), [l.outputs, l.inputs, 3, 3]), &device),
            bias: Tensor::from_data(TensorData::new(l.bias.clone(), [l.outputs]), &device),
        };
        let blocks = weights.blocks.iter().map(|block| block.iter().map(layer).collect()).collect();
        let line = |w: &Vec<f32>| Tensor::from_data(TensorData::new(w.clone(), [1, w.len(), 1, 1]), &device);
        let linear = weights.linear.iter().map(line).collect();
        let most_bytes = most_bytes.min(gpu.binding_limit());
        Ok(Self { gpu, device, blocks, linear, range, most_bytes })
    }

    /// How the images reach the network.
    pub fn range(&self) -> InputRange {
        self.range
    }

    /// Rows of the image, in parts that are whole cells.
    fn bands(&self, width: usize, height: usize) -> Result<Vec<Range<usize>>, LpipsError> {
        // The first block has the most features: 64 channels in float32 for each pixel.
        let row = 4 * 64 * width;
        let rows = usize::try_from(self.most_bytes).unwrap_or(usize::MAX) / row;
        if height <= rows {
            return Ok(std::iter::once(0..height).collect());
        }
        let own = (rows / CELL * CELL).saturating_sub(2 * HALO);
        if own == 0 {
            let bytes = (row * (2 * HALO + CELL)) as u64;
            return Err(LpipsError::TooWide { width, bytes, limit: self.most_bytes });
        }
        Ok((0..height).step_by(own).map(|first| first..height.min(first + own)).collect())
    }

    /// Sums of the weighted squared differences over some rows, one a block. Rows in the halo around them are computed
    /// too, because the features depend on them; errors at the border of the halo do not reach the wanted rows.
    fn band(&self, pair: &Pair, [width, height]: [usize; 2], own: Range<usize>) -> Result<Vec<f64>, LpipsError> {
        let rows = own.start.saturating_sub(HALO)..height.min(own.end + HALO);
        let mut features = [&pair.image, &pair.photo].map(|rgb| self.input(rgb, width, rows.clone()));
        let mut sums = Vec::with_capacity(BLOCKS);
        for (block, linear) in self.linear.iter().enumerate() {
            features = features.map(|x| self.forward(block, x));
            // A block of the image's last, odd rows has no features of its own.
            let end = if own.end == height { height >> block } else { own.end >> block };
            let [first, end, above] = [own.start >> block, end, rows.start >> block];
            if first < end {
                let part = |x: &Tensor<4>| x.clone().slice_dim(2, first - above..end - above);
                let [a, b] = features.each_ref().map(|x| unit(part(x)));
                let difference = a - b;
                sums.push((difference.clone() * difference * linear.clone()).sum());
            } else {
                sums.push(Tensor::zeros([1], &self.device));
            }
        }
        let failed = |e: String| LpipsError::Gpu(GpuError::Readback(e));
        let sums = Tensor::cat(sums, 0).try_into_data().map_err(|e| failed(format!("{e:?}")))?;
        // Data read from a lost device looks like any other result.
        self.gpu.check()?;
        let sums: Vec<f32> = sums.try_into_vec().map_err(|e| failed(format!("{e:?}")))?;
        Ok(sums.into_iter().map(f64::from).collect())
    }

    /// Rows of an image as the network takes them, `[1, 3, rows, width]`.
    fn input(&self, rgb: &[u8], width: usize, rows: Range<usize>) -> Tensor<4> {
        let (first, pixels) = (rows.start * width, rows.len() * width);
        let value = |c: usize, i: usize| {
            let value = f32::from(rgb[3 * (first + i) + c]) / 255.0;
            (self.range.map(value) - SHIFT[c]) / SCALE[c]
        };
        let values: Vec<f32> = (0..3).flat_map(|c| (0..pixels).map(move |i| value(c, i))).collect();
        Tensor::from_data(TensorData::new(values, [1, 3, rows.len(), width]), &self.device)
    }

    fn forward(&self, block: usize, mut x: Tensor<4>) -> Tensor<4> {
        if block > 0 {
            x = max_pool2d(x, MaxPoolOptions::new([2, 2]));
        }
        for layer in &self.blocks[block] {
            let options = ConvOptions::new([1, 1], [1, 1], [1, 1], 1);
            x = relu(conv2d(x, layer.weight.clone(), Some(layer.bias.clone()), options));
        }
        x
    }
}

/// Each pixel's features divided by their length.
fn unit(x: Tensor<4>) -> Tensor<4> {
    let length = (x.clone() * x.clone()).sum_dim(1).sqrt();
    x / (length + EPSILON)
}
