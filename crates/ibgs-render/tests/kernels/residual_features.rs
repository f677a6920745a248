//! The residual network's input and per-view MLP against their twin, forward and backward.

use half::f16;
use ibgs_reference::features::{Composition, EMPTY, View};
use ibgs_reference::finite::assert_gradient;
use ibgs_reference::gpu::gpu;
use ibgs_reference::random_scene::{exact, random_camera, random_image};
use ibgs_reference::relative_error;
use ibgs_render::gpu::{Buffer, Gpu, Pass};
use ibgs_render::residual::features::{
    FeatureGradients, FeatureInputs, Features, GradientByX, InputGradients, MLP_WEIGHTS,
};
use ibgs_render::residual::layers::{CONFIDENCE, INPUT, OUTPUTS, WEIGHTS};
use ibgs_render::residual::{Aggregation, Factor, Output, Variant};
use ibgs_testing::skipped;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const FACTORS: [Factor; 3] = [Factor::Full, Factor::Half, Factor::Quarter];
const AGGREGATIONS: [Aggregation; 2] = [Aggregation::Mean, Aggregation::Soft];

fn variant(aggregation: Aggregation, factor: Factor) -> Variant {
    Variant { output: Output::Residual, aggregation, factor, ..Variant::default() }
}

/// A view with room for `visible` sources a pixel, of which no pixel has more than `most_visible`; numbers that f32 holds.
pub fn random_view(size: [u32; 2], visible: usize, most_visible: usize, variant: Variant, seed: u64) -> View {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let pixels = (size[0] * size[1]) as usize;
    let mut seen = vec![[EMPTY; 4]; pixels];
    for pixel in seen.iter_mut() {
        let filled = rng.random_range(0..=most_visible);
        let first = rng.random_range(0..4u8);
        (0..filled).for_each(|m| pixel[m] = (first + m as u8) | rng.random_range(0..15) << 4);
    }
    let mut number = |low: f64, high: f64| exact(rng.random_range(low..high));
    View {
        camera: random_camera(size[0], size[1], seed),
        variant,
        base: random_image(size[0], size[1], 0.0, 1.0, seed),
        // Where no source is visible there is rubbish that must not matter.
        warped: (0..visible * pixels).map(|_| std::array::from_fn(|_| number(0.0, 1.0))).collect(),
        seen,
        most_visible,
        centers: (0..8).map(|_| std::array::from_fn(|_| number(-1.0, 1.0))).collect(),
        weights: (0..WEIGHTS).map(|_| number(-0.4, 0.4)).collect(),
    }
}

fn random(count: usize, seed: u64) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..count).map(|_| exact(rng.random_range(-1.0..1.0))).collect()
}

/// Those of the per-view MLP and of the confidence.
fn without_unet(weights: &[f64]) -> Vec<f64> {
    [&weights[..MLP_WEIGHTS], &weights[CONFIDENCE.offset..]].concat()
}

fn single(values: &[f64]) -> Vec<f32> {
    values.iter().map(|v| *v as f32).collect()
}

/// The network's output and the gradient by the final colour: with a gated output the sources' gradients depend on them.
fn composed(view: &View) -> (Vec<[f64; OUTPUTS]>, Vec<[f64; 3]>) {
    let low = view.low();
    let output = random(OUTPUTS * low[0] * low[1], 31).as_chunks().0.to_vec();
    (output, random(3 * view.base.len(), 32).as_chunks().0.to_vec())
}

struct OnGpu {
    x: Vec<f64>,
    /// As the matrix units give it, `[pixels][48]`, if they were asked for.
    x_on_units: Vec<f64>,
    v_warped: Vec<f64>,
    v_base: Vec<f64>,
    v_weights: Vec<f64>,
}

/// What the kernels give; v_base starts at one half everywhere, all that is assigned at NaN.
fn on_gpu(view: &View, v_x: &[f64]) -> OnGpu {
    on_gpu_with(view, v_x, false)
}

/// Channels of a pixel in half precision, with padding.
const PADDED: usize = 48;
/// Of gradients in half precision.
const SCALE: f32 = 8.0;

/// The same with the gradient by the U-Net's input in half precision, if the matrix units have a kernel for it.
fn on_gpu_with(view: &View, v_x: &[f64], halves: bool) -> OnGpu {
    let gpu = gpu();
    let upload = |values: &[f64]| gpu.upload("test", &single(values)).unwrap();
    let nan = |count: usize| gpu.upload("test", &vec![f32::NAN; count]).unwrap();
    let read = |buffer: &Buffer<f32>, count: usize| -> Vec<f64> {
        gpu.read(buffer, count).unwrap().into_iter().map(f64::from).collect()
    };
    let seen: Vec<u32> = view.seen.iter().map(|s| u32::from_le_bytes(*s)).collect();
    let centers: Vec<f64> = view.centers.iter().flat_map(|c| [c[0], c[1], c[2], 9.0]).collect();
    let features = Features::new(&view.camera, view.visible() as u32, view.variant);
    let low = features.low();
    let (pixels, n) = (view.base.len(), (low[0] * low[1]) as usize);
    let (base, warped) = (upload(view.base.as_flattened()), upload(view.warped.as_flattened()));
    let (centers, weights) = (upload(&centers), upload(&view.weights));
    let seen = gpu.upload("test", &seen).unwrap();
    let most_visible = gpu.upload("test", &[view.most_visible as u32, 7, 7, 7]).unwrap();
    let inputs = FeatureInputs {
        base: &base,
        warped: &warped.cast(),
        seen: &seen,
        most_visible: &most_visible,
        centers: &centers.cast(),
        weights: &weights,
    };
    let mut packed = vec![f16::ZERO.to_bits(); PADDED * n];
    for (i, v) in v_x.iter().enumerate() {
        packed[i % n * PADDED + i / n] = f16::from_f32(SCALE * *v as f32).to_bits();
    }
    let packed = gpu.upload("test", &packed).unwrap().cast();
    let (base_planes, planes) = (upload(&v_x[(INPUT - 3) * n..]), upload(v_x));
    let v_x = if halves {
        GradientByX::Halves { all: &packed, unscale: SCALE.recip(), base: &base_planes }
    } else {
        GradientByX::Planes(&planes)
    };
    let x = nan(INPUT * n);
    let (v_weights, v_warped) = (nan(WEIGHTS), nan(4 * view.warped.len()));
    let v_base = upload(&vec![0.5; 3 * pixels]);
    let scratch = features.scratch(&gpu).unwrap();
    let gradients = FeatureGradients { v_x, v_weights: &v_weights, scratch: &scratch };
    let mut pass = Pass::new(&gpu, "features");
    features.record(&mut pass, &inputs, &x);
    features.record_backward(&mut pass, &inputs, &gradients);
    let (residual, v_image) = composed(view);
    let (residual, v_image) = (upload(residual.as_flattened()), upload(v_image.as_flattened()));
    let out =
        InputGradients { residual: &residual.cast(), v_image: &v_image, v_warped: &v_warped.cast(), v_base: &v_base };
    features.record_inputs_backward(&mut pass, &inputs, &gradients, &out);
    pass.submit();
    assert_packed(&gpu, &features, &inputs, &read(&x, INPUT * n));
    if gpu.matrix_units.is_some() {
        assert_halves(&gpu, &features, &inputs, &read(&x, INPUT * n));
    }
    let mut x_on_units = Vec::new();
    if halves {
        let halves = gpu.upload("test", &vec![f16::NAN; PADDED * n]).unwrap();
        let mut pass = Pass::new(&gpu, "features");
        features.record_on_units(&mut pass, &inputs, &halves.cast());
        pass.submit();
        x_on_units.extend(gpu.read(&halves, PADDED * n).unwrap().into_iter().map(f64::from));
    }
    let mut v_weights = read(&v_weights, WEIGHTS);
    let unet = &mut v_weights[MLP_WEIGHTS..CONFIDENCE.offset];
    assert!(unet.iter().all(|v| v.is_nan()), "the unet' gradients are not touched");
    unet.fill(0.0);
    let v_base = read(&v_base, 3 * pixels).iter().map(|v| v - 0.5).collect();
    let (x, v_warped) = (read(&x, INPUT * n), read(&v_warped, 4 * view.warped.len()));
    OnGpu { x, x_on_units, v_warped, v_base, v_weights }
}

/// The input of the U-Net as packed halves is the same, rounded to the nearest; the smallest numbers may be zero.
fn assert_packed(gpu: &Gpu, features: &Features, inputs: &FeatureInputs, planes: &[f64]) {
    let n = planes.len() / INPUT;
    let x = gpu.upload("test", &vec![u32::MAX; INPUT / 2 * n]).unwrap();
    let mut pass = Pass::new(gpu, "features");
    features.record_packed(&mut pass, inputs, &x);
    pass.submit();
    for (i, word) in gpu.read(&x, INPUT / 2 * n).unwrap().into_iter().enumerate() {
        for (side, bits) in [word as u16, (word >> 16) as u16].into_iter().enumerate() {
            let (p, channel) = (i % n, 2 * (i / n) + side);
            let expected = planes[channel * n + p];
            let error = (f16::from_bits(bits).to_f64() - expected).abs();
            let most = if expected.abs() < 6.2e-5 { 6.2e-5 } else { 1.001 * expected.abs() / 2048.0 };
            assert!(error <= most, "pixel {p}, channel {channel}: {error:e} of {expected}");
        }
    }
}

/// The input of the U-Net on matrix units is the same, rounded and turned.
fn assert_halves(gpu: &Gpu, features: &Features, inputs: &FeatureInputs, planes: &[f64]) {
    let n = planes.len() / INPUT;
    let x = gpu.upload("test", &vec![u16::MAX; PADDED * n]).unwrap();
    let mut pass = Pass::new(gpu, "features");
    features.record_half(&mut pass, inputs, &x.cast());
    pass.submit();
    for (i, bits) in gpu.read(&x, PADDED * n).unwrap().into_iter().enumerate() {
        let (p, channel) = (i / PADDED, i % PADDED);
        let expected = if channel < INPUT { planes[channel * n + p] } else { 0.0 };
        let error = (f16::from_bits(bits).to_f64() - expected).abs();
        assert!(error <= expected.abs() / 1024.0 + 1e-6, "pixel {p}, channel {channel}: {error:e} of {expected}");
    }
}

fn check(what: &str, view: &View, seed: u64) {
    let n = view.low()[0] * view.low()[1];
    let v_x = random(INPUT * n, seed);
    let ours = on_gpu(view, &v_x);
    let mut grads = view.input_backward(&v_x);
    let composition = Composition {
        size: view.size(),
        variant: view.variant,
        gain: 1.0,
        most_visible: view.most_visible,
        seen: view.seen.clone(),
        warped: view.warped.clone(),
    };
    let (output, v_image) = composed(view);
    let of_mean = composition.compose_backward(&view.base, &output, &v_image);
    let add = |to: &mut [f64], from: &[f64]| to.iter_mut().zip(from).for_each(|(to, from)| *to += from);
    add(grads.warped.as_flattened_mut(), of_mean.warped.as_flattened());
    add(grads.base.as_flattened_mut(), of_mean.base[1].as_flattened());
    let expected = view.input();
    let errors = [
        relative_error(&ours.x, &expected),
        relative_error(&ours.v_warped, grads.warped.as_flattened()),
        relative_error(&ours.v_base, grads.base.as_flattened()),
        relative_error(&ours.v_weights, &grads.weights),
    ];
    println!(
        "{what}: x {:.1e}, v_warped {:.1e}, v_base {:.1e}, v_weights {:.1e}",
        errors[0], errors[1], errors[2], errors[3]
    );
    assert!(errors.iter().all(|e| *e <= 1e-4), "{what}: {errors:?}");
    for (i, v) in grads.warped.as_flattened().iter().enumerate() {
        assert!(*v != 0.0 || ours.v_warped[i] == 0.0, "{what}: v_warped[{i}] is {}", ours.v_warped[i]);
    }
    assert_eq!(view.most_visible > 0, ours.v_weights.iter().any(|v| *v != 0.0), "{what}: gradient of the weights");
}

#[test]
fn every_variant_follows_the_twin() {
    for aggregation in AGGREGATIONS {
        for factor in FACTORS {
            for output in [Output::Residual, Output::Gated] {
                let view = random_view([33, 17], 3, 3, Variant { output, ..variant(aggregation, factor) }, 1);
                check(&format!("{aggregation:?} {factor:?} {output:?}"), &view, 2);
            }
        }
    }
}

/// A view of numbers that halves hold without rounding up to the outputs of the per-view MLP: eighths, and few weights an output. No
/// other value passes a ReLU then.
fn view_of_eighths(size: [u32; 2], visible: usize, most_visible: usize, aggregation: Aggregation, seed: u64) -> View {
    let variant = variant(aggregation, Factor::Full);
    let mut view = random_view(size, visible, most_visible, variant, seed);
    let eighth = |v: &mut f64| *v = (*v * 8.0).round() / 8.0;
    view.base.as_flattened_mut().iter_mut().for_each(eighth);
    view.warped.as_flattened_mut().iter_mut().for_each(eighth);
    view.centers.as_flattened_mut().iter_mut().for_each(eighth);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let sparse = |v: &mut f64| *v = if rng.random_range(0..6) == 0 { v.signum() } else { 0.0 };
    view.weights[..MLP_WEIGHTS].iter_mut().for_each(sparse);
    view.weights[CONFIDENCE.offset..].iter_mut().for_each(|v| *v = (*v * 8.0).round() / 8.0);
    view
}

/// Planes as channels of each pixel, padded with zeros.
fn channels_last(planes: &[f64]) -> Vec<f64> {
    let n = planes.len() / INPUT;
    let value = |i: usize| if i % PADDED < INPUT { planes[i % PADDED * n + i / PADDED] } else { 0.0 };
    (0..PADDED * n).map(value).collect()
}

/// Input and gradients on the matrix units are as near to the twin's as half precision is.
#[test]
fn matrix_units_follow_the_twin_to_half_precision() {
    if gpu().matrix_units.is_none_or(|units| units.side != 16) {
        skipped(
            "kernels::residual_features::matrix_units_follow_the_twin_to_half_precision",
            "no matrix units of 16 x 16",
        );
        return;
    }
    let sizes =
        [([33, 17], 3, 3), ([40, 40], 4, 4), ([5, 3], 3, 2), ([1, 7], 3, 3), ([26, 11], 3, 0), ([256, 200], 3, 3)];
    for (seed, (size, visible, most_visible)) in (10..).zip(sizes) {
        for aggregation in AGGREGATIONS {
            let what = format!("{size:?}, {most_visible} of {visible} sources, {aggregation:?}");
            let view = view_of_eighths(size, visible, most_visible, aggregation, seed);
            let v_x = random(INPUT * view.low()[0] * view.low()[1], seed);
            let ours = on_gpu_with(&view, &v_x, true);
            let twin = view.input_backward(&v_x);
            let x = relative_error(&ours.x_on_units, &channels_last(&view.input()));
            let warped = relative_error(&ours.v_warped, twin.warped.as_flattened());
            let weights = relative_error(&ours.v_weights, &twin.weights);
            println!("{what}: x {x:.1e}, v_warped {warped:.1e}, v_weights {weights:.1e}");
            assert!([x, warped, weights].iter().all(|e| *e <= 1e-3), "{what}: {x:.1e}, {warped:.1e}, {weights:.1e}");
        }
    }
}

#[test]
fn sizes_and_sources_that_no_pixel_has() {
    for (size, visible, most_visible) in
        [([13, 9], 1, 1), ([40, 40], 4, 4), ([5, 3], 3, 2), ([1, 1], 2, 1), ([1, 7], 3, 3), ([26, 11], 3, 0)]
    {
        for factor in FACTORS {
            let view = random_view(size, visible, most_visible, variant(Aggregation::Mean, factor), 3);
            check(&format!("{size:?}, {most_visible} of {visible} sources, {factor:?}"), &view, 4);
        }
    }
}

/// More pixels than the backward pass has threads: its workgroups go round several times.
#[test]
fn large_images_are_summed_whole() {
    let view = random_view([256, 200], 2, 2, variant(Aggregation::Mean, Factor::Full), 5);
    check("256 x 200", &view, 6);
    let v_x = random(INPUT * view.base.len(), 6);
    assert_eq!(on_gpu(&view, &v_x).v_weights, on_gpu(&view, &v_x).v_weights, "the same sums twice");
}

#[test]
fn twin_follows_finite_differences() {
    for aggregation in AGGREGATIONS {
        for factor in [Factor::Full, Factor::Half] {
            let view = random_view([6, 5], 2, 2, variant(aggregation, factor), 7);
            let v_x = random(INPUT * view.low()[0] * view.low()[1], 8);
            let loss = |view: &View| -> f64 { view.input().iter().zip(&v_x).map(|(x, v)| x * v).sum() };
            let grads = view.input_backward(&v_x);
            let what = format!("{aggregation:?} {factor:?}");
            let by_warped = assert_gradient(
                &format!("{what} warped"),
                view.warped.as_flattened(),
                grads.warped.as_flattened(),
                1e-6,
                |at| loss(&View { warped: at.as_chunks().0.to_vec(), ..view.clone() }),
            );
            // The U-Net's part is not read.
            let [own, gradient] = [&view.weights, &grads.weights].map(|w| without_unet(w));
            let by_weights = assert_gradient(&format!("{what} weights"), &own, &gradient, 1e-6, |at| {
                let mut weights = view.weights.clone();
                weights[..MLP_WEIGHTS].copy_from_slice(&at[..MLP_WEIGHTS]);
                weights[CONFIDENCE.offset..].copy_from_slice(&at[MLP_WEIGHTS..]);
                loss(&View { weights, ..view.clone() })
            });
            let by_base = assert_gradient(
                &format!("{what} base"),
                view.base.as_flattened(),
                grads.base.as_flattened(),
                1e-6,
                |at| loss(&View { base: at.as_chunks().0.to_vec(), ..view.clone() }),
            );
            println!("{what}: warped {by_warped:.1e}, weights {by_weights:.1e}, base {by_base:.1e}");
        }
    }
}
