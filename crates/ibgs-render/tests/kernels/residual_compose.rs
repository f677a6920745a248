//! The final colour and its derivative against their twin.

use ibgs_reference::features::{Composition, EMPTY};
use ibgs_reference::finite::assert_gradient;
use ibgs_reference::gpu::gpu;
use ibgs_reference::random_scene::{exact, random_image};
use ibgs_reference::relative_error;
use ibgs_render::gpu::{Buffer, Pass};
use ibgs_render::residual::compose::{Compose, ComposeGradients, ComposeInputs};
use ibgs_render::residual::layers::OUTPUTS;
use ibgs_render::residual::{Factor, Output, Variant};
use ibgs_render::sources::Reach;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const ALL_OUTPUTS: [Output; 2] = [Output::Residual, Output::Gated];
const FACTORS: [Factor; 3] = [Factor::Full, Factor::Half, Factor::Quarter];

const REACHES: [Reach; 2] = [Reach::Everywhere, Reach::Seen];

/// Two of three pixels see up to three sources, or none does; numbers that f32 holds.
fn composition(size: [usize; 2], variant: Variant, most_visible: usize) -> Composition {
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let pixels = size[0] * size[1];
    let mut seen = vec![[EMPTY; 4]; pixels];
    for pixel in seen.iter_mut().enumerate().filter(|(p, _)| most_visible > 0 && p % 3 != 1) {
        let filled = rng.random_range(1..=most_visible);
        (0..filled).for_each(|m| pixel.1[m] = m as u8 | rng.random_range(0..9) << 4);
    }
    let mut number = |low: f64, high: f64| exact(rng.random_range(low..high));
    let warped = (0..3 * pixels).map(|_| [number(0.0, 1.0), number(0.0, 1.0), number(0.0, 1.0), number(0.9, 1.0)]);
    let warped = warped.collect();
    Composition { size, variant, gain: exact(0.3), most_visible, seen, warped }
}

/// Random values of the network's output.
fn random_output([width, height]: [usize; 2], seed: u64) -> Vec<[f64; OUTPUTS]> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..width * height).map(|_| std::array::from_fn(|_| exact(rng.random_range(-1.0..1.0)))).collect()
}

fn check(twin: &Composition) {
    let gpu = gpu();
    let ([w, h], [lw, lh]) = (twin.size, twin.low());
    let image = |seed: u64| random_image(w as u32, h as u32, -1.0, 1.0, seed);
    let (base, residual, v_image) = (image(1), random_output([lw, lh], 2), image(3));
    let upload = |values: &[f64]| {
        let single: Vec<f32> = values.iter().map(|v| *v as f32).collect();
        gpu.upload("test", &single).unwrap()
    };
    let nan = |count: usize| gpu.upload("test", &vec![f32::NAN; count]).unwrap();
    let read = |buffer: &Buffer<f32>, count: usize| -> Vec<f64> {
        gpu.read(buffer, count).unwrap().into_iter().map(f64::from).collect()
    };
    let words: Vec<u32> = twin.seen.iter().map(|s| u32::from_le_bytes(*s)).collect();
    let seen = gpu.upload("test", &words).unwrap();
    let most_visible = gpu.upload("test", &[twin.most_visible as u32, 0, 0, 0]).unwrap();
    let (out, v_residual, v_base) = (nan(3 * w * h), nan(OUTPUTS * lw * lh), nan(3 * w * h));
    let compose = Compose::new([w as u32, h as u32], 3, twin.variant, twin.gain as f32);
    let mut pass = Pass::new(&gpu, "compose");
    let [gpu_base, gpu_residual, gpu_v, warped] =
        [base.as_flattened(), residual.as_flattened(), v_image.as_flattened(), twin.warped.as_flattened()].map(upload);
    let (warped, residual_rows) = (&warped.cast(), &gpu_residual.cast());
    let (most_visible, seen, base_rows) = (&most_visible, &seen, &gpu_base);
    let inputs = ComposeInputs { most_visible, seen, base: base_rows, warped, residual: residual_rows };
    compose.record(&mut pass, &inputs, &out);
    let gradients = ComposeGradients { v_image: &gpu_v, v_residual: &v_residual.cast(), v_base: &v_base };
    compose.record_backward(&mut pass, &inputs, &gradients);
    pass.submit();
    let by = twin.compose_backward(&base, &residual, &v_image);
    let errors = [
        relative_error(&read(&out, 3 * w * h), twin.compose(&base, &residual).as_flattened()),
        relative_error(&read(&v_residual, OUTPUTS * lw * lh), by.residual.as_flattened()),
        relative_error(&read(&v_base, 3 * w * h), by.base[0].as_flattened()),
    ];
    let twin = format!("{:?}, {:?}, {} visible", twin.size, twin.variant, twin.most_visible);
    println!("{twin}: image {:.1e}, v_residual {:.1e}, v_base {:.1e}", errors[0], errors[1], errors[2]);
    assert!(errors.iter().all(|e| *e <= 1e-5), "{twin}: {errors:?}");
}

#[test]
fn every_variant_follows_the_twin() {
    for size in [[33, 17], [13, 9], [1, 1], [3, 40]] {
        for output in ALL_OUTPUTS {
            for factor in FACTORS {
                for (most_visible, reach) in [(3, REACHES[0]), (3, REACHES[1]), (0, REACHES[0]), (0, REACHES[1])] {
                    let variant = Variant { output, factor, reach, ..Variant::default() };
                    check(&composition(size, variant, most_visible));
                }
            }
        }
    }
}

#[test]
fn twin_follows_finite_differences() {
    for output in ALL_OUTPUTS {
        for (factor, reach) in FACTORS.into_iter().flat_map(|factor| REACHES.map(|reach| (factor, reach))) {
            let variant = Variant { output, factor, reach, ..Variant::default() };
            let twin = composition([13, 9], variant, 3);
            let (base, v_image) = (random_image(13, 9, 0.0, 1.0, 4), random_image(13, 9, -1.0, 1.0, 5));
            let residual = random_output(twin.low(), 6);
            let loss = |twin: &Composition, base: &[[f64; 3]], residual: &[[f64; OUTPUTS]]| -> f64 {
                let image = twin.compose(base, residual);
                image.as_flattened().iter().zip(v_image.as_flattened()).map(|(x, v)| x * v).sum()
            };
            let by = twin.compose_backward(&base, &residual, &v_image);
            let mut by_base = by.base[0].clone();
            by_base.as_flattened_mut().iter_mut().zip(by.base[1].as_flattened()).for_each(|(a, b)| *a += b);
            let a = assert_gradient("residual", residual.as_flattened(), by.residual.as_flattened(), 1e-6, |at| {
                loss(&twin, &base, at.as_chunks().0)
            });
            println!("{output:?} {factor:?}: residual {a:.1e}");
            assert_gradient("base", base.as_flattened(), by_base.as_flattened(), 1e-6, |at| {
                loss(&twin, at.as_chunks().0, &residual)
            });
            if output == Output::Gated {
                assert_gradient("sources", twin.warped.as_flattened(), by.warped.as_flattened(), 1e-6, |at| {
                    let twin = Composition { warped: at.as_chunks().0.to_vec(), ..twin.clone() };
                    loss(&twin, &base, &residual)
                });
            } else {
                assert!(by.warped.as_flattened().iter().all(|v| *v == 0.0), "the sources do not enter");
            }
        }
    }
}

/// A constant map stays constant, corners stay where they are.
#[test]
fn corners_are_aligned() {
    let variant = Variant { factor: Factor::Half, ..Variant::default() };
    let twin = Composition { gain: 0.0, ..composition([9, 7], variant, 1) };
    let [w, h] = twin.low();
    let ramp: Vec<[f64; OUTPUTS]> = (0..w * h).map(|i| [(i % w) as f64, (i / w) as f64, 1.0, 0.0]).collect();
    let full = twin.compose(&[[0.0; 3]; 63], &ramp);
    assert_eq!(full[0], [0.0, 0.0, 1.0]);
    let last = full[62];
    assert!((last[0] - (w - 1) as f64).abs() < 1e-12 && (last[1] - (h - 1) as f64).abs() < 1e-12, "{last:?}");
}

/// Where no source is seen the colour is the base colour to the last bit.
#[test]
fn what_is_not_reached_keeps_the_base_colour() {
    for output in ALL_OUTPUTS {
        let variant = Variant { output, reach: Reach::Seen, ..Variant::default() };
        let twin = composition([6, 5], variant, 3);
        let (base, residual) = (random_image(6, 5, 0.0, 1.0, 7), random_output([6, 5], 8));
        let image = twin.compose(&base, &residual);
        for p in 0..30 {
            assert_eq!(image[p] == base[p], !twin.sees(p), "{output:?}, pixel {p}");
        }
    }
}

/// An open gate where one source agrees and looks from the same side gives that source's colour but for what stands against it.
#[test]
fn an_open_gate_passes_the_source() {
    let variant = Variant { output: Output::Gated, factor: Factor::Half, ..Variant::default() };
    let twin = Composition {
        gain: 1.0,
        seen: vec![[0, EMPTY, EMPTY, EMPTY]; 63],
        warped: vec![[0.9, 0.2, 0.4, 1.0]; 63],
        ..composition([9, 7], variant, 1)
    };
    let [w, h] = twin.low();
    let image = twin.compose(&[[0.5; 3]; 63], &vec![[0.0, 0.0, 0.0, 40.0]; w * h]);
    for (color, expected) in image[30].iter().zip([0.9, 0.2, 0.4]) {
        assert!((color - (0.5 + (expected - 0.5) / 1.05)).abs() < 1e-12, "{color}");
    }
}
