//! The floor of each stage: the time that the device needs at the rates measured on it when nothing but what must be
//! done is done, the larger of bytes / bandwidth and operations / rate.
//!
//! Bytes: each input is read once and each output written once. Operations: floating-point ones, a multiply-add counts
//! as two. With N Gaussians of C coefficients a channel, n of them with tiles in the view, I tile intersections, T
//! tiles, P pixels, B pairs of pixel and Gaussian, M sources, V visible sources a pixel of which A are
//! there somewhere, F numbers of a source, K medians, m words of Adam's moments in a
//! Gaussian,
//! p pixels of the network (p / 4 and p / 16 stand for the sizes halved and rounded down), and W weights:
//!
//! | stage | bytes | operations |
//! |---|---|---|
//! | project | 44 n + 12 C n + 56 N; in a frame 6 C n less | (200 + 10 C) n |
//! | sort | 12 N + 48 n + 12 I for the intersections, 20 I + 24 T for the lists, 20 I by depth | 0 |
//! | planes | 44 N | 40 N |
//! | blend | 48 n + 4 I + 8 T + 20 P; with surface also 16 n + 16 P + 12 K P, in a frame 4 P + 4 K P less | 14 B |
//! | depth maps | M times project with C = 1, sort, planes, and 64 n + 4 I + 8 T + 4 P | M times theirs |
//! | warp | (4 + 8 K + 8 M + 16 V + 4) P | 40 min(M, V) P |
//! | features | (12 + 16 A + 4) P + 152 p | 2 (32 F + 32 x 32) A p |
//! | U-Net | 4 bytes an input and output of each layer | 2 a weight and pixel of each layer |
//! | compose | 24 P + 12 p; in a frame also (28 + 16 A) P | 9 P |
//! | image loss | 52 P an image | 660 P an image |
//! | normal loss | 16 P | 60 P |
//! | photometric loss | 8 P + 52 A P | 660 A P |
//! | image loss backward | 64 P an image | 396 P an image |
//! | normal loss backward | 48 P | 120 P |
//! | photometric loss backward | 8 P + 52 A P + 16 V P | 396 A P |
//! | compose backward | 24 P + 12 p | 9 P |
//! | U-Net backward | as forward, for the gradients, and the activations once more | as forward |
//! | U-Net weights | as forward | as forward |
//! | features backward | (16 + 16 A) P + 152 p + 16 A p + (16 V + 24) P | 3 times the forward's |
//! | warp backward | (4 + 8 K + 4 M + 32 V + 4) P + (16 K + 8) P | 40 min(M, V) P |
//! | blend backward | 48 n + 8 I + 8 T + 20 P + 48 I; with surface also 16 n + (20 + 20 K) P + 16 I | 14 B |
//! | planes backward | 56 n + 16 I + 24 n + 16 N | 80 n |
//! | project backward | 60 N + 40 n + 12 C n + 48 I + 72 N | (400 + 20 C) n |
//! | Adam | (8 (11 + 3 C) + 68 + 8 m) N, with planes 48 N more, and 28 W | 14 a value: 11 + 3 C a Gaussian, with planes 4 more, and W |
//!
//! What was assumed:
//! - sort: the lists are sorted in workgroup memory; merges of long lists and integer operations are not counted.
//! - B, read back, is the sum over the pixels of the list entries up to the last contributor. 14 operations (the
//!   exponent, the alpha) are what every pair costs; how many pairs go on to blend is not known, so their share is not
//!   counted. A Gaussian is read once, whichever tiles need it.
//! - the sources' views have as many n and I as the target's. How early their pixels find their median is not known, so
//!   their pairs are not counted. A source's photo and depth map are read once, whole.
//! - the network's convolutions are computed as they stand, without fast algorithms; layers do not share their reads.

use super::rates::Rates;
use super::stage::{Stage, Work};
use crate::optim::{moment_names, moment_words};
use ibgs_core::config::AdamMoments;
use ibgs_core::residual::layers::{
    DEC1, DEC2, ENC1, ENC2, ENC3, FEATURES, FINAL, FUSE, HIDDEN, INPUT, Layer, UP1, UP2, WEIGHTS,
};
use ibgs_core::scene::PerGaussian;
use serde::{Deserialize, Serialize};

/// What the stages of a view have to do; the letters are those of the module's table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Load {
    /// N: Gaussians.
    pub gaussians: u64,
    /// n: Gaussians that touch a tile of the view, read back.
    pub gaussians_in_view: u64,
    /// C: spherical-harmonics coefficients a channel.
    pub coefficients: u64,
    /// How Adam keeps the Gaussians' moments.
    pub moments: AdamMoments,
    /// I: tile intersections, read back.
    pub intersections: u64,
    /// T: tiles.
    pub tiles: u64,
    /// P: pixels.
    pub pixels: u64,
    /// B: pairs of a pixel and a list entry up to its last contributor, read back.
    pub pairs: u64,
    /// M: sources.
    pub sources: u64,
    /// V: visible sources a pixel.
    pub visible: u64,
    /// A: most visible sources of any pixel, read back.
    pub most_visible: u64,
    /// K: median intersections a pixel.
    pub medians: u64,
    /// Width and height at which the network runs; p is their product.
    pub network_size: [u32; 2],
}

/// Least work of a stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Floor {
    /// Bytes read and written.
    pub bytes: f64,
    /// Floating-point operations.
    pub operations: f64,
}

impl Floor {
    const fn new(bytes: f64, operations: f64) -> Self {
        Self { bytes, operations }
    }

    fn plus(self, other: Self) -> Self {
        Self::new(self.bytes + other.bytes, self.operations + other.operations)
    }

    fn times(self, factor: f64) -> Self {
        Self::new(factor * self.bytes, factor * self.operations)
    }

    /// Milliseconds at these rates.
    pub fn ms(&self, rates: &Rates) -> f64 {
        1e3 * (self.bytes / rates.bytes_per_second).max(self.operations / rates.operations_per_second)
    }
}

/// A layer, the halvings of the size at which it is computed, and channels and halvings of each input.
type Placed = (Layer, u32, &'static [(usize, u32)]);

/// The U-Net.
const LAYERS: [Placed; 9] = [
    (ENC1, 0, &[(INPUT, 0)]),
    (ENC2, 1, &[(INPUT, 0)]),
    (ENC3, 2, &[(ENC2.outputs, 1)]),
    (UP2, 1, &[(ENC3.outputs, 2)]),
    (DEC2, 1, &[(UP2.outputs, 1), (ENC2.outputs, 1)]),
    (UP1, 0, &[(DEC2.outputs, 1)]),
    (DEC1, 0, &[(UP1.outputs, 0), (ENC1.outputs, 0)]),
    (FUSE, 0, &[(DEC1.outputs, 0), (INPUT, 0)]),
    (FINAL, 0, &[(FUSE.outputs, 0)]),
];

impl Load {
    fn network_pixels(&self, halvings: u32) -> f64 {
        let [width, height] = self.network_size.map(|side| f64::from(side >> halvings));
        width * height
    }

    /// Inputs and outputs of every layer once, and its multiply-adds.
    fn unet(&self) -> Floor {
        let layer = |(layer, at, inputs): &Placed| {
            let read: f64 = inputs.iter().map(|&(channels, at)| channels as f64 * self.network_pixels(at)).sum();
            let pixels = self.network_pixels(*at);
            Floor::new(4.0 * (read + layer.outputs as f64 * pixels), 2.0 * layer.weights() as f64 * pixels)
        };
        LAYERS.iter().map(layer).fold(Floor::default(), Floor::plus)
    }

    fn project(&self, coefficients: f64, is_frame: bool) -> Floor {
        let (all, seen) = (self.gaussians as f64, self.gaussians_in_view as f64);
        // Frames have the coefficients of the colours as halves.
        let bytes = if is_frame { 6.0 } else { 12.0 };
        Floor::new((44.0 + bytes * coefficients) * seen + 56.0 * all, (200.0 + 10.0 * coefficients) * seen)
    }

    /// Words of Adam's moments of a Gaussian.
    fn moment_words(&self, work: Work) -> f64 {
        let rows = PerGaussian::rows(self.coefficients as usize);
        let each = rows.zip(PerGaussian::with_gradients(work.is_image_based())).into_array().into_iter();
        let words =
            each.map(|(row, is_trained)| usize::from(is_trained) * moment_words(self.moments, row)).sum::<usize>();
        (moment_names(self.moments).len() * words) as f64
    }

    fn sort(&self) -> Floor {
        let [n, seen, i, t] =
            [self.gaussians, self.gaussians_in_view, self.intersections, self.tiles].map(|count| count as f64);
        Floor::new(12.0 * n + 48.0 * seen + (12.0 + 20.0 + 20.0) * i + 24.0 * t, 0.0)
    }

    fn features(&self) -> Floor {
        let (p, low, used) = (self.pixels as f64, self.network_pixels(0), self.most_visible as f64);
        let mlp = 2.0 * (FEATURES * HIDDEN + HIDDEN * HIDDEN) as f64;
        Floor::new((16.0 + 16.0 * used) * p + 4.0 * INPUT as f64 * low, mlp * used * low)
    }

    /// The floor of a stage of `work`; none for kernels that are not known.
    pub fn floor(&self, work: Work, stage: Stage) -> Option<Floor> {
        let [n, seen, c, i, t] =
            [self.gaussians, self.gaussians_in_view, self.coefficients, self.intersections, self.tiles]
                .map(|count| count as f64);
        let [p, b, k] = [self.pixels, self.pairs, self.medians].map(|count| count as f64);
        let surface = f64::from(u8::from(work.is_image_based()));
        // Frames keep no list entries.
        let entries = if work.is_final_frame() { 4.0 + 4.0 * k } else { 0.0 };
        Some(match stage {
            Stage::Project => self.project(c, work.is_frame()),
            Stage::Sort => self.sort(),
            Stage::Planes => Floor::new(44.0 * n, 40.0 * n),
            Stage::Blend => {
                let base = 48.0 * seen + 4.0 * i + 8.0 * t + 20.0 * p;
                Floor::new(base + surface * (16.0 * seen + (16.0 + 12.0 * k - entries) * p), 14.0 * b)
            }
            Stage::BlendBackward => {
                let base = 48.0 * seen + 56.0 * i + 8.0 * t + 20.0 * p;
                Floor::new(base + surface * (16.0 * seen + 16.0 * i + (20.0 + 20.0 * k) * p), 14.0 * b)
            }
            Stage::PlanesBackward => Floor::new(80.0 * seen + 16.0 * (i + n), 80.0 * seen),
            Stage::ProjectBackward => {
                let read = 60.0 * n + (40.0 + 12.0 * c) * seen + 48.0 * i;
                Floor::new(read + 72.0 * n, (400.0 + 20.0 * c) * seen)
            }
            Stage::Adam => {
                let (values, weights) = ((11.0 + 3.0 * c + 4.0 * surface) * n, surface * WEIGHTS as f64);
                let gradients = (56.0 + 12.0 + 16.0 * surface) * n;
                let bytes = 8.0 * values + gradients + 8.0 * self.moment_words(work) * n + 28.0 * weights;
                Floor::new(bytes, 14.0 * (values + weights))
            }
            other => return self.image_floor(work, other),
        })
    }

    /// The stages whose work depends on pixels alone.
    fn image_floor(&self, work: Work, stage: Stage) -> Option<Floor> {
        let [p, m, v, a, k] =
            [self.pixels, self.sources, self.visible, self.most_visible, self.medians].map(|count| count as f64);
        let low = self.network_pixels(0);
        let images = if work == Work::FinalIteration { 2.0 } else { 1.0 };
        Some(match stage {
            Stage::DepthMaps => {
                let [seen, i, t] = [self.gaussians_in_view, self.intersections, self.tiles].map(|count| count as f64);
                let blend = Floor::new(64.0 * seen + 4.0 * i + 8.0 * t + 4.0 * p, 0.0);
                let planes = Floor::new(44.0 * self.gaussians as f64, 40.0 * self.gaussians as f64);
                self.project(1.0, work.is_frame()).plus(self.sort()).plus(planes).plus(blend).times(m)
            }
            Stage::Warp => Floor::new((8.0 + 8.0 * k + 8.0 * m + 16.0 * v) * p, 40.0 * m.min(v) * p),
            Stage::WarpBackward => Floor::new((16.0 + 24.0 * k + 4.0 * m + 32.0 * v) * p, 40.0 * m.min(v) * p),
            Stage::Features => self.features(),
            Stage::FeaturesBackward => {
                let forward = self.features();
                let written = 16.0 * a * low + (16.0 * v + 24.0) * p;
                Floor::new(forward.bytes + written, 3.0 * forward.operations)
            }
            Stage::UNet | Stage::UNetWeights => self.unet(),
            Stage::UNetBackward => {
                let forward = self.unet();
                let signs: f64 =
                    LAYERS[..8].iter().map(|(l, at, _)| 4.0 * l.outputs as f64 * self.network_pixels(*at)).sum();
                Floor::new(forward.bytes + signs, forward.operations)
            }
            Stage::Compose | Stage::ComposeBackward => {
                // Frames take in the sources' mean colour.
                let mix = if work.is_final_frame() { (28.0 + 16.0 * a) * p } else { 0.0 };
                Floor::new(24.0 * p + 16.0 * low + mix, 9.0 * p)
            }
            Stage::ImageLoss => Floor::new(52.0 * p, 660.0 * p).times(images),
            Stage::ImageLossBackward => Floor::new(64.0 * p, 396.0 * p).times(images),
            Stage::NormalLoss => Floor::new(20.0 * p, 60.0 * p),
            Stage::NormalLossBackward => Floor::new(52.0 * p, 120.0 * p),
            Stage::PhotometricLoss => Floor::new((8.0 + 52.0 * a) * p, 660.0 * a * p),
            Stage::PhotometricLossBackward => Floor::new((8.0 + 52.0 * a + 16.0 * v) * p, 396.0 * a * p),
            _ => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load() -> Load {
        Load {
            gaussians: 1000,
            gaussians_in_view: 600,
            coefficients: 16,
            moments: AdamMoments::Full,
            intersections: 3000,
            tiles: 300,
            pixels: 64 * 48,
            pairs: 100_000,
            sources: 4,
            visible: 3,
            most_visible: 2,
            medians: 4,
            network_size: [64, 48],
        }
    }

    #[test]
    fn every_stage_has_a_floor_that_grows_with_its_load() {
        let rates = Rates { bytes_per_second: 1e12, operations_per_second: 1e13 };
        let doubled = Load { gaussians: 2000, gaussians_in_view: 1200, intersections: 6000, ..load() };
        let larger = Load { pixels: 4 * 64 * 48, pairs: 400_000, network_size: [128, 96], ..load() };
        for work in Work::ALL {
            for stage in work.stages() {
                let ms = |load: &Load| load.floor(work, stage).unwrap_or_else(|| panic!("{stage:?}")).ms(&rates);
                assert!(ms(&load()) > 0.0, "{stage:?}");
                assert!(ms(&doubled).max(ms(&larger)) > 1.2 * ms(&load()), "{work:?} {stage:?}");
            }
        }
        assert_eq!(load().floor(Work::BaseFrame, Stage::Other), None);
    }

    #[test]
    fn the_unet_counts_every_weight_once_a_pixel() {
        // Sides that two halvings divide: full, half and quarter size as exact parts.
        let pixels = 64.0 * 48.0;
        let full = 38 * 38 * 9 + 38 * 19 * 9 + 38 * 76 * 9 + 38 * 76 + 4 * 38;
        let half = 19 * 38 * 9 + 19 * 9 * 9 + 19 * 38 * 9;
        let quarter = 9 * 19 * 9;
        let weights = f64::from(full) + f64::from(half) / 4.0 + f64::from(quarter) / 16.0;
        let floor = load().unet();
        assert!((floor.operations - 2.0 * weights * pixels).abs() < 1.0, "{floor:?}");
        // Planes that are read and written at each size.
        let planes = f64::from(76 + 38 + 38 + 114 + 114 + 42)
            + f64::from(19 + 19 + 19 + 57 + 19) / 4.0
            + f64::from(9 + 9) / 16.0;
        assert!((floor.bytes - 4.0 * planes * pixels).abs() < 1.0, "{floor:?}");
    }

    #[test]
    fn the_slower_of_memory_and_arithmetic_counts() {
        let rates = Rates { bytes_per_second: 1e9, operations_per_second: 1e10 };
        assert_eq!(Floor::new(1e6, 1e6).ms(&rates), 1.0);
        assert_eq!(Floor::new(1e6, 1e8).ms(&rates), 10.0);
    }
}
