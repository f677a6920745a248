//! The final colour and its derivative against their twin.

use crate::common::gpu;
use crate::reference::features::Composition;
use crate::reference::finite::assert_gradient;
use crate::reference::random_scene::{exact, random_image};
use crate::reference::relative_error;
use ibgs_core::gpu::{Buffer, Pass};
use ibgs_core::residual::compose::{Compose, ComposeBuffers, ComposeGradients};
use ibgs_core::residual::{Factor, Output, Variant};
use ibgs_core::sources::Reach;

const OUTPUTS: [Output; 2] = [Output::Residual, Output::Color];
const FACTORS: [Factor; 3] = [Factor::Full, Factor::Half, Factor::Quarter];

const REACHES: [Reach; 2] = [Reach::Everywhere, Reach::Seen];

/// Two of three pixels see a source, or none does.
fn sees([w, h]: [usize; 2], seen: bool) -> Vec<bool> {
    (0..w * h).map(|p| seen && p % 3 != 1).collect()
}

fn check(twin: &Composition) {
    let gpu = gpu();
    let ([w, h], [lw, lh]) = (twin.size, twin.low());
    let image = |w: usize, h: usize, seed: u64| random_image(w as u32, h as u32, -1.0, 1.0, seed);
    let (base, residual, v_image) = (image(w, h, 1), image(lw, lh, 2), image(w, h, 3));
    let upload = |map: &[[f64; 3]]| {
        let single: Vec<f32> = map.as_flattened().iter().map(|v| *v as f32).collect();
        gpu.upload("test", &single).unwrap()
    };
    let nan = |pixels: usize| gpu.upload("test", &vec![f32::NAN; 3 * pixels]).unwrap();
    let read = |buffer: &Buffer, pixels: usize| -> Vec<f64> {
        gpu.read::<f32>(buffer, 3 * pixels).unwrap().into_iter().map(f64::from).collect()
    };
    let word = |p: usize| if twin.seen && twin.sees[p] { 0xffff_ff02 } else { u32::MAX };
    let seen = gpu.upload("test", &(0..w * h).map(word).collect::<Vec<u32>>()).unwrap();
    let most_visible = gpu.upload("test", &[2 * u32::from(twin.seen), 0, 0, 0]).unwrap();
    let (out, v_residual, v_base) = (nan(w * h), nan(lw * lh), nan(w * h));
    let compose = Compose::new([w as u32, h as u32], twin.variant, twin.gain as f32);
    let mut pass = Pass::new(&gpu, "compose");
    let (gpu_base, gpu_residual, gpu_v) = (upload(&base), upload(&residual), upload(&v_image));
    let buffers = ComposeBuffers {
        most_visible: &most_visible,
        seen: &seen,
        base: &gpu_base,
        residual: &gpu_residual,
        image: &out,
    };
    compose.record(&mut pass, &buffers);
    let (v_residual, v_base) = (&v_residual, &v_base);
    let gradients = ComposeGradients { most_visible: &most_visible, seen: &seen, v_image: &gpu_v, v_residual, v_base };
    compose.record_backward(&mut pass, &gradients);
    pass.submit();
    let (by_residual, by_base) = twin.compose_backward(&v_image);
    let errors = [
        relative_error(&read(&out, w * h), twin.compose(&base, &residual).as_flattened()),
        relative_error(&read(v_residual, lw * lh), by_residual.as_flattened()),
        relative_error(&read(v_base, w * h), by_base.as_flattened()),
    ];
    let twin = format!("{:?}, {:?}, seen {}", twin.size, twin.variant, twin.seen);
    println!("{twin}: image {:.1e}, v_residual {:.1e}, v_base {:.1e}", errors[0], errors[1], errors[2]);
    assert!(errors.iter().all(|e| *e <= 1e-5), "{twin}: {errors:?}");
}

#[test]
fn every_variant_follows_the_twin() {
    for size in [[33, 17], [13, 9], [1, 1], [3, 40]] {
        for output in OUTPUTS {
            for factor in FACTORS {
                for (seen, reach) in [(true, REACHES[0]), (true, REACHES[1]), (false, REACHES[0]), (false, REACHES[1])]
                {
                    let variant = Variant { output, factor, reach, ..Variant::default() };
                    check(&Composition { size, variant, gain: exact(0.3), seen, sees: sees(size, seen) });
                }
            }
        }
    }
}

#[test]
fn twin_follows_finite_differences() {
    for output in OUTPUTS {
        for (factor, reach) in FACTORS.into_iter().flat_map(|factor| REACHES.map(|reach| (factor, reach))) {
            let variant = Variant { output, factor, reach, ..Variant::default() };
            let size = [13, 9];
            let twin = Composition { size, variant, gain: 0.7, seen: true, sees: sees(size, true) };
            let [lw, lh] = twin.low();
            let (base, v_image) = (random_image(13, 9, 0.0, 1.0, 4), random_image(13, 9, -1.0, 1.0, 5));
            let residual = random_image(lw as u32, lh as u32, -1.0, 1.0, 6);
            let loss = |base: &[[f64; 3]], residual: &[[f64; 3]]| -> f64 {
                let image = twin.compose(base, residual);
                image.as_flattened().iter().zip(v_image.as_flattened()).map(|(x, v)| x * v).sum()
            };
            let (by_residual, by_base) = twin.compose_backward(&v_image);
            let a = assert_gradient("residual", residual.as_flattened(), by_residual.as_flattened(), 1e-6, |at| {
                loss(&base, at.as_chunks().0)
            });
            println!("{output:?} {factor:?}: residual {a:.1e}");
            if output == Output::Residual || reach == Reach::Seen {
                assert_gradient("base", base.as_flattened(), by_base.as_flattened(), 1e-6, |at| {
                    loss(at.as_chunks().0, &residual)
                });
            } else {
                assert!(by_base.as_flattened().iter().all(|v| *v == 0.0), "the base colour does not enter");
            }
        }
    }
}

/// A constant map stays constant, corners stay where they are.
#[test]
fn corners_are_aligned() {
    let variant = Variant { factor: Factor::Half, ..Variant::default() };
    let twin = Composition { size: [9, 7], variant, gain: 0.0, seen: true, sees: Vec::new() };
    let [w, h] = twin.low();
    let ramp: Vec<[f64; 3]> = (0..w * h).map(|i| [(i % w) as f64, (i / w) as f64, 1.0]).collect();
    let full = twin.compose(&[[0.0; 3]; 63], &ramp);
    assert_eq!(full[0], [0.0, 0.0, 1.0]);
    let last = full[62];
    assert!((last[0] - (w - 1) as f64).abs() < 1e-12 && (last[1] - (h - 1) as f64).abs() < 1e-12, "{last:?}");
}

/// Where no source is seen the colour is the base colour to the last bit.
#[test]
fn what_is_not_reached_keeps_the_base_colour() {
    for output in OUTPUTS {
        let variant = Variant { output, reach: Reach::Seen, ..Variant::default() };
        let twin = Composition { size: [6, 5], variant, gain: 0.4, seen: true, sees: sees([6, 5], true) };
        let (base, residual) = (random_image(6, 5, 0.0, 1.0, 7), random_image(6, 5, -1.0, 1.0, 8));
        let image = twin.compose(&base, &residual);
        for p in 0..30 {
            assert_eq!(image[p] == base[p], !twin.sees[p], "{output:?}, pixel {p}");
        }
    }
}
