//! Twin of the U-Net and of its gradients (method.md section 6), for any flat weights in the layout of
//! `ibgs_render::residual::layers`.

use ibgs_render::residual::layers::{DEC1, DEC2, ENC1, ENC2, ENC3, FINAL, FUSE, Layer, UP1, UP2, WEIGHTS};
use rayon::prelude::*;

/// Planes, `[channels][height * width]`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Map {
    pub data: Vec<f64>,
    pub width: usize,
    pub height: usize,
}

impl Map {
    pub fn new(data: Vec<f64>, width: usize, height: usize) -> Self {
        assert_eq!(data.len() % (width * height), 0, "whole planes");
        Self { data, width, height }
    }

    fn pixels(&self) -> usize {
        self.width * self.height
    }

    fn at(&self, c: usize, x: usize, y: usize) -> f64 {
        self.data[(c * self.height + y) * self.width + x]
    }

    /// Channels of `self`, then those of `other`.
    fn with(&self, other: &Map) -> Map {
        let data = self.data.iter().chain(&other.data).copied().collect();
        Map::new(data, self.width, self.height)
    }

    /// The first `channels` channels and the rest.
    fn split(self, channels: usize) -> (Map, Map) {
        let (a, b) = self.data.split_at(channels * self.pixels());
        (Map::new(a.to_vec(), self.width, self.height), Map::new(b.to_vec(), self.width, self.height))
    }

    fn zip(&self, other: &Map, f: impl Fn(f64, f64) -> f64) -> Map {
        let data = self.data.iter().zip(&other.data).map(|(a, b)| f(*a, *b)).collect();
        Map::new(data, self.width, self.height)
    }

    fn relu(mut self) -> Map {
        self.data.iter_mut().for_each(|v| *v = v.max(0.0));
        self
    }

    /// The gradient `self` of an activation before its ReLU.
    fn masked(&self, activation: &Map) -> Map {
        self.zip(activation, |v, a| if a > 0.0 { v } else { 0.0 })
    }
}

/// Offset of a tap and the range of target coordinates for which it lies inside.
fn tap_range(tap: usize, size: usize) -> (isize, std::ops::Range<usize>) {
    let d = tap as isize - 1;
    (d, (-d).max(0) as usize..(size as isize - d).clamp(0, size as isize) as usize)
}

/// Calls `f(weight index, dx, dy, columns, rows)` for every tap of one output and input.
fn taps(
    layer: &Layer,
    map: &Map,
    o: usize,
    i: usize,
    mut f: impl FnMut(usize, [isize; 2], [std::ops::Range<usize>; 2]),
) {
    let base = layer.offset + (o * layer.inputs + i) * layer.taps;
    if layer.taps == 1 {
        return f(base, [0, 0], [0..map.width, 0..map.height]);
    }
    for tap in 0..9 {
        let (dx, columns) = tap_range(tap % 3, map.width);
        let (dy, rows) = tap_range(tap / 3, map.height);
        f(base + tap, [dx, dy], [columns, rows]);
    }
}

/// Convolution without activation.
pub fn conv(weights: &[f64], layer: &Layer, x: &Map) -> Map {
    let n = x.pixels();
    assert_eq!(x.data.len(), layer.inputs * n, "{}", layer.name);
    let mut out = vec![0.0; layer.outputs * n];
    out.par_chunks_mut(n).enumerate().for_each(|(o, plane)| {
        plane.fill(weights[layer.bias() + o]);
        for i in 0..layer.inputs {
            taps(layer, x, o, i, |w, [dx, dy], [columns, rows]| {
                for py in rows {
                    for px in columns.clone() {
                        let there = x.at(i, px.wrapping_add_signed(dx), py.wrapping_add_signed(dy));
                        plane[py * x.width + px] += weights[w] * there;
                    }
                }
            });
        }
    });
    Map::new(out, x.width, x.height)
}

/// Gradient of [`conv`] by its input; adds those by weights and biases to `v_weights`.
pub fn conv_backward(weights: &[f64], layer: &Layer, x: &Map, v: &Map, v_weights: &mut [f64]) -> Map {
    let n = x.pixels();
    let mut v_x = vec![0.0; layer.inputs * n];
    let by_weight = |i: usize, v_plane: &mut [f64]| {
        let mut sums = Vec::new();
        for o in 0..layer.outputs {
            taps(layer, x, o, i, |w, [dx, dy], [columns, rows]| {
                let mut sum = 0.0;
                for py in rows {
                    for px in columns.clone() {
                        let (tx, ty) = (px.wrapping_add_signed(dx), py.wrapping_add_signed(dy));
                        let up = v.at(o, px, py);
                        sum += up * x.at(i, tx, ty);
                        v_plane[ty * x.width + tx] += up * weights[w];
                    }
                }
                sums.push((w, sum));
            });
        }
        sums
    };
    let sums: Vec<_> = v_x.par_chunks_mut(n).enumerate().map(|(i, plane)| by_weight(i, plane)).collect();
    for (w, sum) in sums.into_iter().flatten() {
        v_weights[w] += sum;
    }
    for o in 0..layer.outputs {
        v_weights[layer.bias() + o] += v.data[o * n..(o + 1) * n].iter().sum::<f64>();
    }
    Map::new(v_x, x.width, x.height)
}

/// Position of the largest of 2 x 2 (the first of equals) for every pooled value.
fn largest(x: &Map) -> (Vec<usize>, usize, usize) {
    let (w, h) = (x.width / 2, x.height / 2);
    let channels = x.data.len() / x.pixels();
    let mut at = Vec::with_capacity(channels * w * h);
    for c in 0..channels {
        for (y, px) in (0..h).flat_map(|y| (0..w).map(move |px| (y, px))) {
            let first = (c * x.height + 2 * y) * x.width + 2 * px;
            let window = [first, first + 1, first + x.width, first + x.width + 1];
            at.push(window.into_iter().reduce(|a, b| if x.data[b] > x.data[a] { b } else { a }).unwrap());
        }
    }
    (at, w, h)
}

/// The maximum of 2 x 2, sizes rounded down.
pub fn pool(x: &Map) -> Map {
    let (at, w, h) = largest(x);
    Map::new(at.into_iter().map(|i| x.data[i]).collect(), w, h)
}

fn pool_backward(x: &Map, v: &Map) -> Map {
    let mut v_x = vec![0.0; x.data.len()];
    for (i, v) in largest(x).0.into_iter().zip(&v.data) {
        v_x[i] += v;
    }
    Map::new(v_x, x.width, x.height)
}

/// Source position of every enlarged value: the nearest, rounded down.
fn nearest(x: &Map, width: usize, height: usize) -> Vec<usize> {
    let channels = x.data.len() / x.pixels();
    let mut at = Vec::with_capacity(channels * width * height);
    for c in 0..channels {
        for (y, px) in (0..height).flat_map(|y| (0..width).map(move |px| (y, px))) {
            at.push((c * x.height + y * x.height / height) * x.width + px * x.width / width);
        }
    }
    at
}

/// Enlarges to the size of `like`.
pub fn enlarge(x: &Map, like: &Map) -> Map {
    let at = nearest(x, like.width, like.height);
    Map::new(at.into_iter().map(|i| x.data[i]).collect(), like.width, like.height)
}

fn enlarge_backward(x: &Map, v: &Map) -> Map {
    let mut v_x = vec![0.0; x.data.len()];
    for (i, v) in nearest(x, v.width, v.height).into_iter().zip(&v.data) {
        v_x[i] += v;
    }
    Map::new(v_x, x.width, x.height)
}

/// All activations.
#[derive(Clone, Debug)]
pub struct Forward {
    pub x: Map,
    pub e1: Map,
    pub e2: Map,
    pub b: Map,
    pub u2: Map,
    pub d2: Map,
    pub u1: Map,
    pub d1: Map,
    pub f: Map,
    /// Four planes.
    pub residual: Map,
}

/// From x (38 planes) to the output (4 planes).
pub fn forward(weights: &[f64], x: &Map) -> Forward {
    assert_eq!(weights.len(), WEIGHTS, "weights of the whole network");
    let e1 = conv(weights, &ENC1, x).relu();
    let e2 = conv(weights, &ENC2, &pool(&e1)).relu();
    let b = conv(weights, &ENC3, &pool(&e2)).relu();
    let u2 = conv(weights, &UP2, &enlarge(&b, &e2)).relu();
    let d2 = conv(weights, &DEC2, &u2.with(&e2)).relu();
    let u1 = conv(weights, &UP1, &enlarge(&d2, &e1)).relu();
    let d1 = conv(weights, &DEC1, &u1.with(&e1)).relu();
    let f = conv(weights, &FUSE, &d1.with(x)).relu();
    let residual = conv(weights, &FINAL, &f);
    Forward { x: x.clone(), e1, e2, b, u2, d2, u1, d1, f, residual }
}

/// Gradients of sum(v_residual * residual) by x and by all weights (zero for those of the per-view MLP).
pub fn backward(weights: &[f64], forward: &Forward, v_residual: &Map) -> (Map, Vec<f64>) {
    let Forward { x, e1, e2, b, u2, d2, u1, d1, f, .. } = forward;
    let mut v_weights = vec![0.0; WEIGHTS];
    let mut back = |layer: &Layer, input: &Map, v: &Map| conv_backward(weights, layer, input, v, &mut v_weights);
    let v_f = back(&FINAL, f, v_residual);
    let (v_d1, v_x) = back(&FUSE, &d1.with(x), &v_f.masked(f)).split(ENC1.outputs);
    let (v_u1, v_e1) = back(&DEC1, &u1.with(e1), &v_d1.masked(d1)).split(UP1.outputs);
    let v_d2 = enlarge_backward(d2, &back(&UP1, &enlarge(d2, e1), &v_u1.masked(u1)));
    let (v_u2, v_e2) = back(&DEC2, &u2.with(e2), &v_d2.masked(d2)).split(UP2.outputs);
    let v_b = enlarge_backward(b, &back(&UP2, &enlarge(b, e2), &v_u2.masked(u2)));
    let v_pooled = back(&ENC3, &pool(e2), &v_b.masked(b));
    let v_e2 = v_e2.zip(&pool_backward(e2, &v_pooled), |a, b| a + b);
    let v_pooled = back(&ENC2, &pool(e1), &v_e2.masked(e2));
    let v_e1 = v_e1.zip(&pool_backward(e1, &v_pooled), |a, b| a + b);
    let v_x = v_x.zip(&back(&ENC1, x, &v_e1.masked(e1)), |a, b| a + b);
    (v_x, v_weights)
}
