//! The U-Net in float32 against its twin, forward and backward; `half` tests the same on matrix units.

use crate::common::values;
use burn::tensor::activation::relu;
use burn::tensor::module::{conv2d, interpolate, max_pool2d};
use burn::tensor::ops::{ConvOptions, InterpolateMode, InterpolateOptions, MaxPoolOptions};
use burn::tensor::{Tensor, TensorData};
use ibgs_core::gpu::profile::Measured;
use ibgs_core::gpu::{Gpu, Pass};
use ibgs_core::raster::Keep;
use ibgs_core::residual::layers::{
    DEC1, DEC2, ENC1, ENC2, ENC3, FINAL, FUSE, INPUT, LAYERS, Layer, OUTPUTS, UNET, UP1, UP2, WEIGHTS,
};
use ibgs_core::residual::{Arithmetic, UNet};
use ibgs_reference::finite::assert_gradient;
use ibgs_reference::gpu::{gpu, without_subgroups};
use ibgs_reference::random_scene::exact;
use ibgs_reference::relative_error;
use ibgs_reference::unet::{Map, backward, forward};
use ibgs_train::tensor::device;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::time::Instant;

fn uniform(count: usize, limit: f64, rng: &mut ChaCha8Rng) -> Vec<f64> {
    (0..count).map(|_| exact(rng.random_range(-limit..limit))).collect()
}

/// The default initialisation of the network: uniform in +-1/sqrt(fan_in).
pub(super) fn random_weights(seed: u64) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let layer = |l: &Layer| {
        let limit = 1.0 / ((l.inputs * l.taps) as f64).sqrt();
        uniform(l.weights() + l.outputs, limit, &mut rng)
    };
    LAYERS.iter().flat_map(layer).collect()
}

/// Random x and v_residual (four planes).
pub(super) fn random_maps(width: usize, height: usize, seed: u64) -> (Map, Map) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut planes = |channels| Map::new(uniform(channels * width * height, 1.0, &mut rng), width, height);
    (planes(INPUT), planes(OUTPUTS))
}

pub(super) fn single(values: &[f64]) -> Vec<f32> {
    values.iter().map(|v| *v as f32).collect()
}

pub(super) fn double(values: &[f32]) -> Vec<f64> {
    values.iter().map(|v| f64::from(*v)).collect()
}

/// Planes to an interleaved image.
pub(super) fn interleaved(map: &Map) -> Vec<f64> {
    let n = map.width * map.height;
    (0..OUTPUTS * n).map(|i| map.data[(i % OUTPUTS) * n + i / OUTPUTS]).collect()
}

/// What stands in `v_weights` before the backward pass.
pub(super) const UNTOUCHED: f32 = 7.0;

pub(super) struct OnGpu {
    pub residual: Vec<f32>,
    pub v_x: Vec<f32>,
    pub v_weights: Vec<f32>,
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|v| v.to_bits()).collect()
}

fn unet(gpu: &Gpu, x: &Map, keep: Keep, arithmetic: Arithmetic) -> UNet {
    let size = [x.width as u32, x.height as u32];
    let unet = UNet::new(gpu, size, keep, arithmetic).unwrap();
    assert_eq!((unet.size(), unet.has_gradients()), (size, keep == Keep::Gradients));
    unet.write_input(gpu, &single(&x.data));
    unet
}

pub(super) fn forward_on_gpu(weights: &[f64], x: &Map, keep: Keep, arithmetic: Arithmetic) -> Vec<f32> {
    let gpu = gpu();
    let unet = unet(&gpu, x, keep, arithmetic);
    let weights = gpu.upload("weights", &single(weights)).unwrap();
    let mut pass = Pass::new(&gpu, "unet");
    unet.forward(&mut pass, &weights);
    pass.submit();
    gpu.read(unet.residual(), x.width * x.height).unwrap().into_flattened()
}

pub(super) fn on_gpu(weights: &[f64], x: &Map, v_residual: &Map, arithmetic: Arithmetic) -> OnGpu {
    on(&gpu(), weights, x, v_residual, arithmetic)
}

/// Forward and backward, twice over: the second time must not see anything of the first.
fn on(gpu: &Gpu, weights: &[f64], x: &Map, v_residual: &Map, arithmetic: Arithmetic) -> OnGpu {
    let n = x.width * x.height;
    let unet = unet(gpu, x, Keep::Gradients, arithmetic);
    let weights = gpu.upload("weights", &single(weights)).unwrap();
    let v_residual = gpu.upload("v_residual", single(&interleaved(v_residual)).as_chunks().0).unwrap();
    let v_weights = gpu.upload("v_weights", &[UNTOUCHED; WEIGHTS]).unwrap();
    let run = || {
        let mut pass = Pass::new(gpu, "unet");
        unet.forward(&mut pass, &weights);
        unet.backward(&mut pass, &weights, &v_residual, &v_weights);
        pass.submit();
        OnGpu {
            residual: gpu.read(unet.residual(), n).unwrap().into_flattened(),
            v_x: unet.read_v_x(gpu).unwrap(),
            v_weights: gpu.read(&v_weights, WEIGHTS).unwrap(),
        }
    };
    let (first, second) = (run(), run());
    assert_eq!(bits(&first.residual), bits(&second.residual), "the residual repeats bit for bit");
    assert_eq!(bits(&first.v_x), bits(&second.v_x), "v_x repeats bit for bit");
    assert_eq!(bits(&first.v_weights), bits(&second.v_weights), "v_weights repeat bit for bit");
    second
}

fn assert_forward(what: &str, ours: &[f32], twin: &[f64]) {
    assert_eq!(ours.len(), twin.len(), "{what}: size");
    let scale = twin.iter().fold(0.0f64, |a, v| a.max(v.abs()));
    let error = ours.iter().zip(twin).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max) / scale;
    println!("{what}: largest error {error:.1e} of {scale:.2}");
    assert!(scale > 0.0 && error <= 1e-5, "{what}: {error:e}");
}

fn assert_close(what: &str, ours: &[f32], twin: &[f64]) {
    assert!(twin.iter().any(|v| *v != 0.0), "{what}: the twin's gradient is zero");
    let error = relative_error(&double(ours), twin);
    println!("{what}: {error:.1e}");
    assert!(error <= 1e-4, "{what}: relative error {error:e}");
}

const SIZES: [(usize, usize); 6] = [(4, 4), (13, 9), (5, 34), (37, 21), (70, 6), (64, 48)];

#[test]
fn forward_follows_the_twin_with_and_without_gradients() {
    let weights = random_weights(1);
    for (width, height) in SIZES {
        let (x, _) = random_maps(width, height, 2);
        let twin = interleaved(&forward(&weights, &x).residual);
        let [rendered, trained] =
            [Keep::Image, Keep::Gradients].map(|keep| forward_on_gpu(&weights, &x, keep, Arithmetic::Full));
        assert_forward(&format!("{width} x {height}"), &rendered, &twin);
        assert_eq!(rendered, trained, "{width} x {height}: the memory plan does not matter");
    }
}

#[test]
fn gradients_follow_the_twin_layer_by_layer_and_repeat() {
    let weights = random_weights(3);
    for (width, height) in SIZES {
        let (x, v_residual) = random_maps(width, height, 4);
        let passed = forward(&weights, &x);
        let (v_x, v_weights) = backward(&weights, &passed, &v_residual);
        let ours = on_gpu(&weights, &x, &v_residual, Arithmetic::Full);
        let what = format!("{width} x {height}");
        assert_forward(&what, &ours.residual, &interleaved(&passed.residual));
        assert_close(&format!("{what} v_x"), &ours.v_x, &v_x.data);
        for layer in UNET {
            let [weight, bias] = [layer.offset..layer.bias(), layer.bias()..layer.end()];
            let name = format!("{what} {}", layer.name);
            assert_close(&format!("{name}.weight"), &ours.v_weights[weight.clone()], &v_weights[weight]);
            assert_close(&format!("{name}.bias"), &ours.v_weights[bias.clone()], &v_weights[bias]);
        }
        let mut others = ours.v_weights[..ENC1.offset].iter().chain(&ours.v_weights[FINAL.end()..]);
        assert!(others.all(|v| *v == UNTOUCHED), "{what}: the parts of the MLP and of the confidence are left alone");
    }
}

/// Activations are rounded to halves: the residual must be as near to the twin as on matrix units.
#[test]
fn packed_halves_give_the_residual_to_half_precision() {
    for (seed, (width, height)) in (0..).zip(SIZES) {
        let weights = random_weights(seed);
        let (x, _) = random_maps(width, height, seed);
        let twin = interleaved(&forward(&weights, &x).residual);
        let ours = forward_on_gpu(&weights, &x, Keep::Image, Arithmetic::Packed);
        let error = relative_error(&double(&ours), &twin);
        println!("{width} x {height}: {error:.1e}");
        assert!(error <= 1e-3, "{width} x {height}: relative error {error:e}");
        assert_ne!(ours, forward_on_gpu(&weights, &x, Keep::Image, Arithmetic::Full), "{width} x {height}: rounded");
    }
}

/// A network that passes one value on: 100 x in e1, which is more than a half holds, and a thousandth of that in d1.
#[test]
fn packed_halves_saturate() {
    let mut weights = vec![0.0; WEIGHTS];
    let mut connect = |layer: &Layer, input: usize, weight: f64| {
        weights[layer.offset + input * layer.taps + layer.taps / 2] = weight;
    };
    connect(&ENC1, 0, 100.0);
    connect(&DEC1, INPUT, 0.001);
    connect(&FUSE, 0, 1.0);
    connect(&FINAL, 0, 1.0);
    let x = Map::new(vec![1000.0; INPUT * 8 * 5], 8, 5);
    let residual = forward_on_gpu(&weights, &x, Keep::Image, Arithmetic::Packed);
    assert!(residual.iter().step_by(OUTPUTS).all(|v| *v == 65.5), "{residual:?}");
}

/// The convolution has a form for subgroups of 8 lanes.
#[test]
fn subgroups_do_not_matter() {
    let without = without_subgroups();
    let weights = random_weights(14);
    for &(width, height) in &SIZES[1..4] {
        let (x, v_residual) = random_maps(width, height, 15);
        let [a, b] = [&*gpu(), &*without].map(|gpu| on(gpu, &weights, &x, &v_residual, Arithmetic::Full));
        assert!(bits(&a.residual) == bits(&b.residual), "{width} x {height}: residual");
        assert!(bits(&a.v_x) == bits(&b.v_x), "{width} x {height}: v_x");
    }
}

/// A training finds a NaN by its gradients.
#[test]
fn a_nan_goes_on_to_the_gradients() {
    let weights = random_weights(16);
    let (x, mut v_residual) = random_maps(37, 12, 17);
    let at = 3 * x.width + 8;
    v_residual.data[at] = f64::NAN;
    let [a, b] = [gpu(), without_subgroups()].map(|gpu| on(&gpu, &weights, &x, &v_residual, Arithmetic::Full));
    let nans = |values: &[f32]| -> Vec<bool> { values.iter().map(|v| v.is_nan()).collect() };
    assert!(a.v_x[at].is_nan() && a.v_x.iter().any(|v| !v.is_nan()));
    assert!(nans(&a.v_x) == nans(&b.v_x), "the same with subgroups and without");
}

/// Dark x and biases far below zero: nothing passes any ReLU, so only the last bias learns.
#[test]
fn a_dead_network_has_exactly_zero_gradients() {
    let mut weights = random_weights(5);
    for layer in &UNET[..8] {
        weights[layer.bias()..layer.end()].fill(-100.0);
    }
    let (x, v_residual) = random_maps(21, 10, 6);
    let ours = on_gpu(&weights, &x, &v_residual, Arithmetic::Full);
    assert!(ours.v_x.iter().all(|v| *v == 0.0));
    let last = UNET[8];
    assert!(ours.v_weights[ENC1.offset..last.bias()].iter().all(|v| *v == 0.0));
    let (_, v_weights) = backward(&weights, &forward(&weights, &x), &v_residual);
    assert_close("last bias", &ours.v_weights[last.bias()..last.end()], &v_weights[last.bias()..last.end()]);
}

/// Chosen entries of x and of every layer's weights and biases against central differences.
#[test]
fn the_twins_gradients_follow_finite_differences() {
    let weights = random_weights(7);
    let (x, v_residual) = random_maps(9, 7, 8);
    let (v_x, v_weights) = backward(&weights, &forward(&weights, &x), &v_residual);
    let loss = |weights: &[f64], x: &Map| -> f64 {
        forward(weights, x).residual.data.iter().zip(&v_residual.data).map(|(a, b)| a * b).sum()
    };
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let mut choose =
        |range: std::ops::Range<usize>| -> Vec<usize> { (0..6).map(|_| rng.random_range(range.clone())).collect() };
    let pick = |values: &[f64], at: &[usize]| -> Vec<f64> { at.iter().map(|i| values[*i]).collect() };
    let put = |values: &[f64], at: &[usize], new: &[f64]| -> Vec<f64> {
        let mut values = values.to_vec();
        at.iter().zip(new).for_each(|(i, v)| values[*i] = *v);
        values
    };
    for layer in UNET {
        for (what, range) in [("weight", layer.offset..layer.bias()), ("bias", layer.bias()..layer.end())] {
            let mut at = choose(range);
            at.sort_unstable();
            at.dedup();
            let f = |new: &[f64]| loss(&put(&weights, &at, new), &x);
            let name = format!("{}.{what}", layer.name);
            let error = assert_gradient(&name, &pick(&weights, &at), &pick(&v_weights, &at), 1e-6, f);
            println!("{name}: {error:.1e}");
        }
    }
    let at: Vec<usize> = (0..x.data.len()).step_by(97).collect();
    let f = |new: &[f64]| loss(&weights, &Map::new(put(&x.data, &at, new), 9, 7));
    let error = assert_gradient("x", &pick(&x.data, &at), &pick(&v_x.data, &at), 1e-6, f);
    println!("x: {error:.1e}");
}

/// The same network of burn's own layers.
#[test]
fn the_twin_is_the_network_of_ordinary_layers() {
    let gpu = gpu();
    let weights = random_weights(12);
    let tensor =
        |values: &[f64]| Tensor::<1>::from_data(TensorData::new(single(values), [values.len()]), device(&gpu).unwrap());
    let conv = |layer: &Layer, x: Tensor<4>| {
        let side = if layer.taps == 9 { 3 } else { 1 };
        let shape = [layer.outputs, layer.inputs, side, side];
        let weight = tensor(&weights[layer.offset..layer.bias()]).reshape(shape);
        let bias = tensor(&weights[layer.bias()..layer.end()]);
        conv2d(x, weight, Some(bias), ConvOptions::new([1, 1], [side / 2; 2], [1, 1], 1))
    };
    let pool = |x: &Tensor<4>| max_pool2d(x.clone(), MaxPoolOptions::new([2, 2]));
    let enlarge = |x: Tensor<4>, like: &Tensor<4>| {
        let [_, _, height, width] = like.dims();
        interpolate(x, InterpolateOptions::new(InterpolateMode::Nearest).with_output_size([height, width]))
    };
    for (width, height) in [(13, 9), (23, 30)] {
        let (x, _) = random_maps(width, height, 13);
        let input = tensor(&x.data).reshape([1, INPUT, height, width]);
        let e1 = relu(conv(&ENC1, input.clone()));
        let e2 = relu(conv(&ENC2, pool(&e1)));
        let b = relu(conv(&ENC3, pool(&e2)));
        let u2 = relu(conv(&UP2, enlarge(b, &e2)));
        let d2 = relu(conv(&DEC2, Tensor::cat(vec![u2, e2], 1)));
        let u1 = relu(conv(&UP1, enlarge(d2, &e1)));
        let d1 = relu(conv(&DEC1, Tensor::cat(vec![u1, e1], 1)));
        let f = relu(conv(&FUSE, Tensor::cat(vec![d1, input], 1)));
        let ours = values(conv(&FINAL, f));
        assert_forward(&format!("burn, {width} x {height}"), &single(&ours), &forward(&weights, &x).residual.data);
    }
}

/// Milliseconds at 540 x 960, in all and by kernel. For a real GPU: `cargo test unet_speed -- --ignored --nocapture`,
/// best in release.
#[test]
#[ignore = "a measurement, for a real GPU"]
fn unet_speed() {
    let gpu = gpu();
    let (width, height) = (960usize, 540usize);
    let mut rng = ChaCha8Rng::seed_from_u64(10);
    let planes = uniform(INPUT * width * height, 1.0, &mut rng);
    let weights = gpu.upload("weights", &single(&random_weights(11))).unwrap();
    let v_residual = single(&uniform(OUTPUTS * width * height, 1.0, &mut rng));
    let v_residual = gpu.upload("v_residual", v_residual.as_chunks().0).unwrap();
    let v_weights = gpu.upload("v_weights", &[0.0f32; WEIGHTS]).unwrap();
    for (precision, arithmetic, keep) in [
        ("full", Arithmetic::Full, Keep::Gradients),
        ("frame full", Arithmetic::Full, Keep::Image),
        ("frame packed", Arithmetic::Packed, Keep::Image),
        ("half", Arithmetic::Half, Keep::Gradients),
    ] {
        let path = UNet::new(&gpu, [width as u32, height as u32], keep, arithmetic).unwrap();
        path.write_input(&gpu, &single(&planes));
        let run = |what: &'static str, run: &dyn Fn(&mut Pass)| {
            let once = || {
                let mut pass = Pass::new(&gpu, what);
                run(&mut pass);
                pass.submit();
            };
            let repeat = if gpu.is_software() { 1 } else { 20 };
            once();
            gpu.wait().unwrap();
            let start = Instant::now();
            (0..repeat).for_each(|_| once());
            gpu.wait().unwrap();
            println!("{precision} {what}: {:.3} ms", 1e3 * start.elapsed().as_secs_f64() / f64::from(repeat));
            if gpu.start_profile() {
                (0..repeat).for_each(|_| once());
                for Measured { kernel, ms, dispatches, .. } in gpu.finish_profile() {
                    let [ms, dispatches] = [ms, dispatches as f64].map(|sum| sum / f64::from(repeat));
                    println!("    {}: {ms:.3} ms in {dispatches}", kernel.name);
                }
            }
        };
        run("forward", &|pass| path.forward(pass, &weights));
        // Repeated without a forward in between the numbers are meaningless, the work is the same.
        if path.has_gradients() {
            run("backward", &|pass| path.backward(pass, &weights, &v_residual, &v_weights));
        }
    }
}
