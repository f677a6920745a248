//! Twin of the residual network's input, its per-view MLP and the final composition, with their derivatives (method.md
//! sections 5 and 6). Everything is done in the plain order of the text: features at full size, then the resize, then
//! the MLP.

use ibgs_data::camera::Camera;
use ibgs_render::residual::layers::{CONFIDENCE, FEATURES, HIDDEN, INPUT, MLP1, MLP2, OUTPUTS, WEIGHTS};
use ibgs_render::residual::{Aggregation, Output, Variant};
use ibgs_render::sources::Reach;

/// Place of the cosine among the numbers of a source.
const COSINE: usize = 6;

/// In place of a source's number where there is no visible source m.
pub const EMPTY: u8 = 255;

/// What the network's input is made of; maps are row by row, visible source after visible source.
#[derive(Clone, Debug)]
pub struct View {
    pub camera: Camera,
    pub variant: Variant,
    pub base: Vec<[f64; 3]>,
    /// Colour and cosine, V x pixels.
    pub warped: Vec<[f64; 4]>,
    /// Number of visible source m of a pixel, and 16 times the thirds of the depth agreement by which it is off.
    pub seen: Vec<[u8; 4]>,
    /// Most visible sources of any pixel.
    pub most_visible: usize,
    /// Target centre - source centre.
    pub centers: Vec<[f64; 3]>,
    /// The flat weights; those of the MLP and of the confidence are read.
    pub weights: Vec<f64>,
}

/// Gradients by the inputs.
#[derive(Clone, Debug)]
pub struct Grads {
    pub warped: Vec<[f64; 4]>,
    pub base: Vec<[f64; 3]>,
    pub weights: Vec<f64>,
}

type Size = [usize; 2];

/// Source indices and weights of resized index i, corners aligned.
fn taps(i: usize, src: usize, dst: usize) -> [(usize, f64); 2] {
    let at = if dst > 1 { i as f64 * (src - 1) as f64 / (dst - 1) as f64 } else { 0.0 };
    let first = (at.floor() as usize).min(src - 1);
    let fraction = at - first as f64;
    [(first, 1.0 - fraction), ((first + 1).min(src - 1), fraction)]
}

/// Calls `f(resized pixel, source pixel, weight)` for every pair that is connected.
fn each_tap(src: Size, dst: Size, mut f: impl FnMut(usize, usize, f64)) {
    for y in 0..dst[1] {
        for x in 0..dst[0] {
            if src == dst {
                f(y * dst[0] + x, y * dst[0] + x, 1.0);
                continue;
            }
            for (row, down) in taps(y, src[1], dst[1]) {
                for (column, across) in taps(x, src[0], dst[0]) {
                    f(y * dst[0] + x, row * src[0] + column, down * across);
                }
            }
        }
    }
}

/// Bilinear resize with corners aligned.
pub fn resize<const N: usize>(map: &[[f64; N]], src: Size, dst: Size) -> Vec<[f64; N]> {
    let mut out = vec![[0.0; N]; dst[0] * dst[1]];
    each_tap(src, dst, |to, at, weight| (0..N).for_each(|c| out[to][c] += weight * map[at][c]));
    out
}

/// Its transpose.
pub fn resize_backward<const N: usize>(v_out: &[[f64; N]], src: Size, dst: Size) -> Vec<[f64; N]> {
    let mut v_map = vec![[0.0; N]; src[0] * src[1]];
    each_tap(src, dst, |to, at, weight| (0..N).for_each(|c| v_map[at][c] += weight * v_out[to][c]));
    v_map
}

/// Entry i of each.
fn at<T: Copy>(all: &[Vec<T>], i: usize) -> Vec<T> {
    all.iter().map(|values| values[i]).collect()
}

fn relu_layer(weights: &[f64], bias: &[f64], input: &[f64]) -> [f64; HIDDEN] {
    std::array::from_fn(|o| {
        let row = &weights[o * input.len()..(o + 1) * input.len()];
        (bias[o] + row.iter().zip(input).map(|(w, x)| w * x).sum::<f64>()).max(0.0)
    })
}

impl View {
    pub fn size(&self) -> Size {
        [self.camera.width as usize, self.camera.height as usize]
    }

    pub fn low(&self) -> Size {
        self.variant.factor.size([self.camera.width, self.camera.height]).map(|n| n as usize)
    }

    pub fn visible(&self) -> usize {
        self.warped.len() / self.base.len()
    }

    fn features(&self, m: usize) -> Vec<[f64; FEATURES]> {
        let feature = |p: usize| {
            let source = self.seen[p][m];
            if source == EMPTY {
                return [0.0; FEATURES];
            }
            let [r, g, b, cosine] = self.warped[m * self.base.len() + p];
            let base = self.base[p];
            let [x, y, z] = self.centers[usize::from(source & 15)];
            [r - base[0], g - base[1], b - base[2], x, y, z, cosine]
        };
        resize(&(0..self.base.len()).map(feature).collect::<Vec<_>>(), self.size(), self.low())
    }

    fn mlp(&self, feature: &[f64; FEATURES]) -> ([f64; HIDDEN], [f64; HIDDEN]) {
        let w = &self.weights;
        let first = relu_layer(&w[MLP1.offset..], &w[MLP1.bias()..], feature);
        (first, relu_layer(&w[MLP2.offset..], &w[MLP2.bias()..], &first))
    }

    /// At each pixel of the network's size the share of pixels that have a visible source m, and the error of its depth as
    /// a share of the agreement.
    fn presence(&self, m: usize) -> Vec<[f64; 2]> {
        let filling = |seen: &[u8; 4]| match seen[m] {
            EMPTY => [0.0; 2],
            byte => [1.0, f64::from(byte >> 4) / 3.0],
        };
        let mut low = resize(&self.seen.iter().map(filling).collect::<Vec<_>>(), self.size(), self.low());
        low.iter_mut().filter(|[part, _]| *part > 0.0).for_each(|[part, error]| *error /= *part);
        low
    }

    /// Shares of the visible sources of a pixel by their confidences, beside 1 for none of them.
    fn shares(&self, features: &[[f64; FEATURES]], presence: &[[f64; 2]]) -> Vec<f64> {
        let w = &self.weights;
        let confidence = |(feature, [present, error]): (&[f64; FEATURES], &[f64; 2])| {
            let (first, _) = self.mlp(feature);
            let sum = first.iter().zip(&w[CONFIDENCE.offset..]).map(|(h, w)| h * w).sum::<f64>();
            present * (w[CONFIDENCE.bias()] + w[CONFIDENCE.bias() - 1] * error + sum).exp()
        };
        let confidences: Vec<f64> = features.iter().zip(presence).map(confidence).collect();
        let total = 1.0 + confidences.iter().sum::<f64>();
        confidences.into_iter().map(|c| c / total).collect()
    }

    /// The U-Net's input, planes [38][pixels of the network's size].
    pub fn input(&self) -> Vec<f64> {
        let ([w, h], n) = (self.size(), self.low()[0] * self.low()[1]);
        let features: Vec<_> = (0..self.most_visible).map(|m| self.features(m)).collect();
        let ray = |p: usize| self.camera.ray(glam::DVec2::new((p % w) as f64 + 0.5, (p / w) as f64 + 0.5)).to_array();
        let rays = resize(&(0..w * h).map(ray).collect::<Vec<_>>(), self.size(), self.low());
        let base = resize(&self.base, self.size(), self.low());
        let presence: Vec<_> = (0..self.most_visible).map(|m| self.presence(m)).collect();
        let mut x = vec![0.0; INPUT * n];
        for i in 0..n {
            let outputs: Vec<_> = features.iter().map(|f| self.mlp(&f[i]).1).collect();
            let shares = self.shares(&at(&features, i), &at(&presence, i));
            for c in 0..HIDDEN {
                x[c * n + i] = match self.variant.aggregation {
                    _ if outputs.is_empty() => 0.0,
                    Aggregation::Mean => outputs.iter().map(|h| h[c]).sum::<f64>() / outputs.len() as f64,
                    Aggregation::Soft => outputs.iter().zip(&shares).map(|(h, share)| share * h[c]).sum(),
                };
            }
            let ray = glam::DVec3::from_array(rays[i]).normalize().to_array();
            for c in 0..3 {
                x[(HIDDEN + c) * n + i] = ray[c];
                x[(HIDDEN + 3 + c) * n + i] = base[i][c];
            }
        }
        x
    }

    /// Gradients of `sum(v_x * input())`.
    pub fn input_backward(&self, v_x: &[f64]) -> Grads {
        let (pixels, n) = (self.base.len(), self.low()[0] * self.low()[1]);
        let features: Vec<_> = (0..self.most_visible).map(|m| self.features(m)).collect();
        let mut v_features = vec![vec![[0.0; FEATURES]; n]; self.most_visible];
        let presence: Vec<_> = (0..self.most_visible).map(|m| self.presence(m)).collect();
        let mut weights = vec![0.0; WEIGHTS];
        for i in 0..n {
            let outputs: Vec<_> = features.iter().map(|f| self.mlp(&f[i]).1).collect();
            let shares = self.shares(&at(&features, i), &at(&presence, i));
            let products: Vec<f64> =
                outputs.iter().map(|h| h.iter().enumerate().map(|(c, h)| h * v_x[c * n + i]).sum()).collect();
            let mean: f64 = shares.iter().zip(&products).map(|(share, product)| share * product).sum();
            for m in 0..self.most_visible {
                let v_confidence = match self.variant.aggregation {
                    Aggregation::Soft => shares[m] * (products[m] - mean),
                    _ => 0.0,
                };
                let v_output = std::array::from_fn(|c| match self.variant.aggregation {
                    Aggregation::Mean => v_x[c * n + i] / self.most_visible as f64,
                    Aggregation::Soft => shares[m] * v_x[c * n + i],
                });
                v_features[m][i] = self.mlp_backward(&features[m][i], v_output, v_confidence, &mut weights);
                weights[CONFIDENCE.bias() - 1] += v_confidence * presence[m][i][1];
            }
        }
        let v_color: Vec<[f64; 3]> = (0..n).map(|i| std::array::from_fn(|c| v_x[(HIDDEN + 3 + c) * n + i])).collect();
        let base = resize_backward(&v_color, self.size(), self.low());
        let mut grads = Grads { warped: vec![[0.0; 4]; self.warped.len()], base, weights };
        for (m, v) in v_features.iter().enumerate() {
            let v = resize_backward(v, self.size(), self.low());
            for p in (0..pixels).filter(|p| self.seen[*p][m] != EMPTY) {
                grads.warped[m * pixels + p] = [v[p][0], v[p][1], v[p][2], v[p][COSINE]];
                (0..3).for_each(|c| grads.base[p][c] -= v[p][c]);
            }
        }
        grads
    }

    fn mlp_backward(
        &self,
        feature: &[f64; FEATURES],
        v_output: [f64; HIDDEN],
        v_confidence: f64,
        v_weights: &mut [f64],
    ) -> [f64; FEATURES] {
        let (first, second) = self.mlp(feature);
        let mut v_first: [f64; HIDDEN] = std::array::from_fn(|k| v_confidence * self.weights[CONFIDENCE.offset + k]);
        v_weights[CONFIDENCE.bias()] += v_confidence;
        (0..HIDDEN).for_each(|k| v_weights[CONFIDENCE.offset + k] += v_confidence * first[k]);
        for o in (0..HIDDEN).filter(|o| second[*o] > 0.0) {
            v_weights[MLP2.bias() + o] += v_output[o];
            for k in 0..HIDDEN {
                v_weights[MLP2.offset + o * HIDDEN + k] += v_output[o] * first[k];
                v_first[k] += v_output[o] * self.weights[MLP2.offset + o * HIDDEN + k];
            }
        }
        let mut v_feature = [0.0; FEATURES];
        for o in (0..HIDDEN).filter(|o| first[*o] > 0.0) {
            v_weights[MLP1.bias() + o] += v_first[o];
            for k in 0..FEATURES {
                v_weights[MLP1.offset + o * FEATURES + k] += v_first[o] * feature[k];
                v_feature[k] += v_first[o] * self.weights[MLP1.offset + o * FEATURES + k];
            }
        }
        v_feature
    }
}

/// How the final colour is made.
#[derive(Clone, Debug)]
pub struct Composition {
    pub size: Size,
    pub variant: Variant,
    pub gain: f64,
    /// Most visible sources of any pixel.
    pub most_visible: usize,
    /// As in [`View`]: read where the variant reaches pixels that see a source alone, and with a gated output.
    pub seen: Vec<[u8; 4]>,
    /// As in [`View`]; read with a gated output.
    pub warped: Vec<[f64; 4]>,
}

/// Gradients of the final colour.
#[derive(Clone, Debug)]
pub struct CompositionGrads {
    pub residual: Vec<[f64; OUTPUTS]>,
    /// In two parts: that of the base colour itself, and that through the mean difference.
    pub base: [Vec<[f64; 3]>; 2],
    pub warped: Vec<[f64; 4]>,
}

/// Difference 1 - cosine at which a source counts 1/e, and what stands against the sources' weights.
const SPREAD: f64 = 0.05;
const DOUBT: f64 = 0.05;

fn logistic(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

impl Composition {
    pub fn low(&self) -> Size {
        self.variant.factor.size(self.size.map(|n| n as u32)).map(|n| n as usize)
    }

    pub fn sees(&self, pixel: usize) -> bool {
        self.seen[pixel][0] != EMPTY
    }

    fn is_reached(&self, pixel: usize) -> bool {
        self.variant.reach == Reach::Everywhere || self.sees(pixel)
    }

    /// Whether the network's output counts at a pixel.
    fn is_added(&self, pixel: usize) -> bool {
        self.most_visible > 0 && self.is_reached(pixel)
    }

    fn base_share(&self, pixel: usize) -> f64 {
        if self.is_reached(pixel) { self.gain } else { 1.0 }
    }

    /// Place in `warped`, difference from the base colour and weight of every source that a pixel sees.
    fn differences(&self, pixel: usize, base: [f64; 3]) -> Vec<(usize, [f64; 3], f64)> {
        let places = self.warped.len() / self.seen.len();
        let of = |m: usize| {
            let at = m * self.seen.len() + pixel;
            let ([r, g, b, cosine], error) = (self.warped[at], f64::from(self.seen[pixel][m] >> 4) / 3.0);
            let weight = (-0.5 * error * error - (1.0 - cosine) / SPREAD).exp();
            (at, [r - base[0], g - base[1], b - base[2]], weight)
        };
        (0..places).filter(|m| self.seen[pixel][*m] != EMPTY).map(of).collect()
    }

    /// The mean difference of all sources, and the sum of their weights.
    fn mean_difference(&self, pixel: usize, base: [f64; 3]) -> ([f64; 3], f64) {
        let all = self.differences(pixel, base);
        let sum = DOUBT + all.iter().map(|(_, _, weight)| weight).sum::<f64>();
        (std::array::from_fn(|c| all.iter().map(|(_, d, weight)| weight * d[c]).sum::<f64>() / sum), sum)
    }

    /// The final colour.
    pub fn compose(&self, base: &[[f64; 3]], residual: &[[f64; OUTPUTS]]) -> Vec<[f64; 3]> {
        let full = resize(residual, self.low(), self.size);
        let pixel = |p: usize| {
            let shared = base[p].map(|v| self.base_share(p) * v);
            if !self.is_added(p) {
                return shared;
            }
            let gate = if self.variant.output == Output::Gated { logistic(full[p][3]) } else { 0.0 };
            let (mean, _) = self.mean_difference(p, base[p]);
            std::array::from_fn(|c| shared[c] + full[p][c] + gate * mean[c])
        };
        (0..base.len()).map(pixel).collect()
    }

    /// Gradients by the network's output, the base colour and the sources.
    pub fn compose_backward(
        &self,
        base: &[[f64; 3]],
        residual: &[[f64; OUTPUTS]],
        v_image: &[[f64; 3]],
    ) -> CompositionGrads {
        let full = resize(residual, self.low(), self.size);
        let mut v_full = vec![[0.0; OUTPUTS]; base.len()];
        let mut through = vec![[0.0; 3]; base.len()];
        let mut warped = vec![[0.0; 4]; self.warped.len()];
        for (p, v) in v_image.iter().enumerate().filter(|(p, _)| self.is_added(*p)) {
            v_full[p][..3].copy_from_slice(v);
            if self.variant.output != Output::Gated {
                continue;
            }
            let dot = |a: [f64; 3]| (0..3).map(|c| a[c] * v[c]).sum::<f64>();
            let (gate, (mean, sum)) = (logistic(full[p][3]), self.mean_difference(p, base[p]));
            v_full[p][3] = gate * (1.0 - gate) * dot(mean);
            for (at, difference, weight) in self.differences(p, base[p]) {
                (0..3).for_each(|c| warped[at][c] = gate * weight / sum * v[c]);
                (0..3).for_each(|c| through[p][c] -= warped[at][c]);
                let apart = std::array::from_fn(|c| difference[c] - mean[c]);
                warped[at][3] = gate * weight / SPREAD * dot(apart) / sum;
            }
        }
        let own = v_image.iter().enumerate().map(|(p, v)| v.map(|x| self.base_share(p) * x)).collect();
        let residual = resize_backward(&v_full, self.low(), self.size);
        CompositionGrads { residual, base: [own, through], warped }
    }
}
