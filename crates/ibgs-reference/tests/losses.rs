//! Image loss, spherical harmonics, optimiser and sorting twins.

use std::f64::consts::PI;

use glam::DVec3;

use ibgs_reference::adam::{Adam, pack, random_bits, unpack};
use ibgs_reference::finite::assert_gradient;
use ibgs_reference::image_loss::{image_loss, image_loss_backward, l1, ssim, ssim_map, window};
use ibgs_reference::random_scene::random_image;
use ibgs_reference::{sh, sort};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const SIZE: (usize, usize) = (17, 13);

fn images(seed: u64) -> (Vec<[f64; 3]>, Vec<[f64; 3]>) {
    let (w, h) = (SIZE.0 as u32, SIZE.1 as u32);
    (random_image(w, h, 0.0, 1.0, seed), random_image(w, h, 0.0, 1.0, seed + 100))
}

#[test]
fn image_loss_gradient_agrees_with_finite_differences() {
    for (seed, lambda) in [(1, 0.2), (2, 0.0), (3, 1.0)] {
        let (image, target) = images(seed);
        let gradient = image_loss_backward(&image, &target, SIZE.0, SIZE.1, lambda);
        let loss = |v: &[f64]| image_loss(v.as_chunks().0, &target, SIZE.0, SIZE.1, lambda);
        let name = format!("lambda {lambda}");
        let worst = assert_gradient(&name, image.as_flattened(), gradient.as_flattened(), 1e-6, loss);
        println!("image loss, {name}: worst relative error {worst:.1e}");
    }
}

#[test]
fn equal_images_have_no_loss_and_no_gradient_by_l1() {
    let (image, _) = images(4);
    assert_eq!(l1(&image, &image), 0.0);
    assert!((ssim(&image, &image, SIZE.0, SIZE.1) - 1.0).abs() < 1e-12);
    let gradient = image_loss_backward(&image, &image, SIZE.0, SIZE.1, 0.0);
    assert!(gradient.as_flattened().iter().all(|v| *v == 0.0));
}

/// SSIM of one pixel from centred sums over the two-dimensional window, zeros outside the image.
fn ssim_directly(image: &[[f64; 3]], target: &[[f64; 3]], x: usize, y: usize, c: usize) -> f64 {
    let mut samples = Vec::new();
    for (j, wy) in window().iter().enumerate() {
        for (i, wx) in window().iter().enumerate() {
            let at = (x + i).checked_sub(5).zip((y + j).checked_sub(5));
            let at = at.filter(|(x, y)| *x < SIZE.0 && *y < SIZE.1);
            let (a, b) = at.map_or((0.0, 0.0), |(x, y)| (image[y * SIZE.0 + x][c], target[y * SIZE.0 + x][c]));
            samples.push((wx * wy, a, b));
        }
    }
    let mean = |f: &dyn Fn(f64, f64) -> f64| samples.iter().map(|(w, a, b)| w * f(*a, *b)).sum::<f64>();
    let (ma, mb) = (mean(&|a, _| a), mean(&|_, b| b));
    let variance_a = mean(&|a, _| (a - ma).powi(2));
    let variance_b = mean(&|_, b| (b - mb).powi(2));
    let covariance = mean(&|a, b| (a - ma) * (b - mb));
    (2.0 * ma * mb + 1e-4) * (2.0 * covariance + 9e-4) / ((ma * ma + mb * mb + 1e-4) * (variance_a + variance_b + 9e-4))
}

#[test]
fn ssim_agrees_with_a_direct_window() {
    let (image, target) = images(5);
    let map = ssim_map(&image, &target, SIZE.0, SIZE.1);
    for y in 0..SIZE.1 {
        for x in 0..SIZE.0 {
            for (c, ssim) in map[y * SIZE.0 + x].into_iter().enumerate() {
                let direct = ssim_directly(&image, &target, x, y, c);
                assert!((ssim - direct).abs() < 1e-12, "pixel {x} {y} channel {c}");
            }
        }
    }
    assert!((window().iter().sum::<f64>() - 1.0).abs() < 1e-15);
}

fn factorial(n: i32) -> f64 {
    (1..=n).map(f64::from).product()
}

/// Associated Legendre polynomial with the Condon-Shortley phase, by the usual recurrence.
fn legendre(l: i32, m: i32, x: f64) -> f64 {
    let double_factorial: f64 = (1..=m).map(|k| f64::from(2 * k - 1)).product();
    let mut current = (-1.0f64).powi(m) * double_factorial * (1.0 - x * x).powf(f64::from(m) / 2.0);
    let mut before = 0.0;
    for k in m + 1..=l {
        let next = (f64::from(2 * k - 1) * x * current - f64::from(k + m - 1) * before) / f64::from(k - m);
        (before, current) = (current, next);
    }
    current
}

/// Real spherical harmonic from angles.
fn harmonic(l: i32, m: i32, d: DVec3) -> f64 {
    let a = m.abs();
    let norm = (f64::from(2 * l + 1) / (4.0 * PI) * factorial(l - a) / factorial(l + a)).sqrt();
    let phi = d.y.atan2(d.x);
    let angular = match m {
        0 => 1.0,
        1.. => 2f64.sqrt() * (f64::from(a) * phi).cos(),
        _ => 2f64.sqrt() * (f64::from(a) * phi).sin(),
    };
    norm * angular * legendre(l, a, d.z)
}

#[test]
fn harmonics_agree_with_legendre_polynomials() {
    for raw in random_image(5, 5, -1.0, 1.0, 6) {
        let d = DVec3::from_array(raw).normalize();
        let basis = sh::basis(d);
        for l in 0..=3i32 {
            for m in -l..=l {
                let index = (l * l + l + m) as usize;
                let error = (basis[index] - harmonic(l, m, d)).abs();
                assert!(error < 1e-12, "degree {l} order {m}: {error:e}");
            }
        }
    }
}

#[test]
fn harmonics_gradient_agrees_with_finite_differences() {
    for raw in random_image(3, 3, -1.0, 1.0, 7) {
        let gradients = sh::basis_gradient(DVec3::from_array(raw));
        for (k, gradient) in gradients.iter().enumerate().skip(1) {
            let value = |d: &[f64]| sh::basis(DVec3::from_slice(d))[k];
            assert_gradient(&format!("basis {k}"), &raw, &gradient.to_array(), 1e-7, value);
        }
    }
}

#[test]
fn clamped_colours_pass_nothing() {
    let coefficients = [-3.0, 1.0, -1.7724538509055159];
    let (v_sh, _) = sh::color_backward(&coefficients, 0, DVec3::Z, [1.0; 3]);
    assert!(sh::color(&coefficients, 0, DVec3::Z)[0] < 0.0);
    assert_eq!(v_sh[0], 0.0);
    assert!((v_sh[1] - 0.28209479177387814).abs() < 1e-15);
}

/// Steps of 1000 values by noisy gradients, all or one of twenty of them: those with packed moments are as long, on average.
#[test]
fn packed_moments_keep_the_steps() {
    let adam = Adam::gaussians(1.0);
    for visited in [1.0, 0.05] {
        let mut rng = ChaCha8Rng::seed_from_u64(6);
        let (mut products, mut squares, mut means) = (0.0, 0.0, [0.0; 2]);
        for value in 0..1000 {
            let mean = rng.random_range(-1e-6..1e-6);
            let (mut exact, mut packed, mut code) = ([0.0; 3], [0.0; 3], 0);
            for step in 1..=1000 {
                let seen = rng.random_range(0.0..1.0) < visited;
                let gradient = [if seen { mean + rng.random_range(-2e-6..2e-6) } else { 0.0 }];
                [packed[1], packed[2]] = unpack(code);
                for state in [&mut exact, &mut packed] {
                    let [at, m, v] = state.each_mut().map(std::slice::from_mut);
                    adam.step(step, at, &gradient, m, v);
                }
                code = pack([packed[1], packed[2]], random_bits(value, step).next().unwrap());
            }
            products += exact[0] * packed[0];
            squares += exact[0] * exact[0];
            means = [means[0] + exact[2], means[1] + packed[2]];
        }
        let (way, second) = (products / squares, means[1] / means[0]);
        assert!((0.99..1.01).contains(&way), "{way} of the way");
        assert!((second - 1.0).abs() < 0.02, "{second} of the second moments");
    }
}

#[test]
fn adam_follows_its_definition() {
    let adam = Adam::gaussians(0.01);
    let gradients = [[0.5, -2.0, 0.0], [0.25, 1.0, 0.0], [-1.0, 1.0, 1e-20]];
    let (mut value, mut m, mut v) = ([1.0, 2.0, 3.0], [0.0; 3], [0.0; 3]);
    adam.step(1, &mut value, &gradients[0], &mut m, &mut v);
    // The first step moves by the learning rate against the sign; no gradient, no step.
    assert!((value[0] - 0.99).abs() < 1e-12 && (value[1] - 2.01).abs() < 1e-12 && value[2] == 3.0);
    adam.step(2, &mut value, &gradients[1], &mut m, &mut v);
    adam.step(3, &mut value, &gradients[2], &mut m, &mut v);
    // The moments as weighted sums over all gradients.
    for i in 0..2 {
        let g = gradients.map(|g| g[i]);
        let first = 0.1 * (0.81 * g[0] + 0.9 * g[1] + g[2]);
        let second = 0.001 * (0.998001 * g[0] * g[0] + 0.999 * g[1] * g[1] + g[2] * g[2]);
        assert!((m[i] - first).abs() < 1e-15 && (v[i] - second).abs() < 1e-15);
    }
    // A gradient of 1e-20 is far under eps: almost no step.
    assert!((value[2] - 3.0).abs() < 1e-6);
}

#[test]
fn scan_and_sort() {
    let (scanned, total) = sort::exclusive_scan(&[3, 0, 2, u32::MAX, 1]);
    assert_eq!((scanned, total), (vec![0, 3, 3, 5, 4], 5));
    let (keys, values) = sort::stable_sort(&[2u64, 1, 2, 0, 1], &['a', 'b', 'c', 'd', 'e']);
    assert_eq!((keys, values), (vec![0, 1, 1, 2, 2], vec!['d', 'b', 'e', 'a', 'c']));
}
