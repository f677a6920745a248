//! The U-Net on matrix units against its twin, forward and backward.

use super::residual::{OnGpu, UNTOUCHED, double, forward_on_gpu, interleaved, on_gpu, random_maps, random_weights};
use ibgs_core::gpu::device_descriptor;
use ibgs_core::raster::Keep;
use ibgs_core::residual::Arithmetic;
use ibgs_core::residual::layers::{ENC1, FINAL, OUTPUTS, UNET};
use ibgs_core::residual::unet::choice::{self, WholeNumbers, seconds_a_pixel};
use ibgs_core::residual::variant::Precision;
use ibgs_reference::gpu::{device_of, gpu};
use ibgs_reference::relative_error;
use ibgs_reference::unet::{Map, backward, forward};
use ibgs_testing::skipped;

/// Forward and backward on the matrix units; none where the adapter has none.
fn on_matrix_units(weights: &[f64], x: &Map, v_residual: &Map) -> Option<OnGpu> {
    gpu().matrix_units?;
    let ours = on_gpu(weights, x, v_residual, Arithmetic::Half);
    let rendered = forward_on_gpu(weights, x, Keep::Image, Arithmetic::Half);
    assert_eq!(rendered, ours.residual, "the memory plan does not matter");
    Some(ours)
}

/// Weights and maps that halves hold without any rounding.
fn whole_numbers(width: usize, height: usize, seed: u64) -> (Vec<f64>, Map, Map) {
    let numbers = WholeNumbers::new(width as u32, height as u32, seed);
    let n = width * height;
    let v_residual = (0..OUTPUTS * n).map(|i| f64::from(numbers.v_residual[(i % n) * OUTPUTS + i / n])).collect();
    let planes = Map::new(double(&numbers.planes), width, height);
    (double(&numbers.weights), planes, Map::new(v_residual, width, height))
}

fn assert_near(what: &str, ours: &[f32], twin: &[f64], tolerance: f64) {
    assert!(twin.iter().any(|v| *v != 0.0), "{what}: the twin's values are zero");
    let error = relative_error(&double(ours), twin);
    println!("{what}: {error:.1e}");
    assert!(error <= tolerance, "{what}: relative error {error:e}");
}

/// Why a test of the matrix units does not run.
const NO_UNITS: &str = "this adapter has no matrix units that fit";

const MATRIX_SIZES: [(usize, usize); 5] = [(4, 4), (17, 9), (33, 18), (64, 48), (75, 53)];

/// The path through matrix units keeps weights and activations in half precision and sums in float32: the residual must be as
/// near to the twin as that rounding, at any size. Of random gradients nothing can be said: where rounding makes another value
/// the largest of four, or lets another pass its ReLU, they are others.
#[test]
fn matrix_units_give_the_residual_to_half_precision() {
    for (seed, (width, height)) in (0..).zip(MATRIX_SIZES) {
        let weights = random_weights(seed);
        let (x, v_residual) = random_maps(width, height, seed);
        let Some(ours) = on_matrix_units(&weights, &x, &v_residual) else {
            skipped("kernels::half::matrix_units_give_the_residual_to_half_precision", NO_UNITS);
            return;
        };
        let twin = interleaved(&forward(&weights, &x).residual);
        assert_near(&format!("{width} x {height}"), &ours.residual, &twin, 1e-3);
    }
}

/// Where no activation is rounded the gradients are those of the twin. (At 4 x 4 a layer's may all be zero.)
#[test]
fn matrix_units_give_the_gradients_of_whole_numbers() {
    for (seed, &(width, height)) in (0..).zip(&MATRIX_SIZES[1..]) {
        let (weights, x, v_residual) = whole_numbers(width, height, seed);
        let Some(ours) = on_matrix_units(&weights, &x, &v_residual) else {
            skipped("kernels::half::matrix_units_give_the_gradients_of_whole_numbers", NO_UNITS);
            return;
        };
        let passed = forward(&weights, &x);
        let (v_x, v_weights) = backward(&weights, &passed, &v_residual);
        let what = format!("{width} x {height}");
        assert_eq!(double(&ours.residual), interleaved(&passed.residual), "{what}: residual");
        assert_near(&format!("{what} v_x"), &ours.v_x, &v_x.data, 1e-4);
        for layer in UNET {
            let all = layer.offset..layer.end();
            assert_near(&format!("{what} {}", layer.name), &ours.v_weights[all.clone()], &v_weights[all], 1e-4);
        }
        let mut others = ours.v_weights[..ENC1.offset].iter().chain(&ours.v_weights[FINAL.end()..]);
        assert!(others.all(|v| *v == UNTOUCHED), "{what}: the parts of the MLP and of the confidence are left alone");
    }
}

/// The test at start-up accepts what is right.
#[test]
fn the_test_of_the_matrix_units_passes() {
    let gpu = gpu();
    let error = choice::error(&gpu).unwrap();
    println!("matrix units: {:?}, error {error:?}", gpu.matrix_units);
    assert_eq!(error.is_some(), gpu.matrix_units.is_some());
    assert!(error.is_none_or(|error| error < 1e-4), "{error:?}");
}

/// On a device of its own, of which nothing is kept.
#[test]
fn the_time_of_the_unet_is_measured() {
    let own = device_of(device_descriptor);
    let seconds = seconds_a_pixel(&own, Precision::Full, 0.0).unwrap();
    println!("U-Net: {seconds:.1e} s a pixel");
    assert!((1e-12..1e-3).contains(&seconds), "{seconds}");
}
