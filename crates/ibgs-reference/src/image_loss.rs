//! Twin of the image loss and of its gradient by the image (method.md section 7).

use rayon::prelude::*;

/// Taps of the SSIM window to either side of its centre.
const HALF: usize = 5;
const SIGMA: f64 = 1.5;
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// An image or any other map of three channels, row by row.
pub type Map = Vec<[f64; 3]>;

/// The 11 weights of the Gaussian window; they sum to one.
pub fn window() -> [f64; 2 * HALF + 1] {
    let tap = |i: usize| (-(i as f64 - HALF as f64).powi(2) / (2.0 * SIGMA * SIGMA)).exp();
    let sum: f64 = (0..=2 * HALF).map(tap).sum();
    std::array::from_fn(|i| tap(i) / sum)
}

/// Separable Gaussian window with zeros outside the image. It is its own transpose.
pub fn blur(map: &[[f64; 3]], width: usize, height: usize) -> Map {
    let pass = |source: &[[f64; 3]], along_x: bool| -> Map {
        let weights = window();
        let value = |i: usize| {
            let (x, y) = (i % width, i / width);
            let (at, size, stride) = if along_x { (x, width, 1) } else { (y, height, width) };
            let mut sum = [0.0; 3];
            for (tap, weight) in weights.iter().enumerate() {
                let Some(there) = (at + tap).checked_sub(HALF).filter(|p| *p < size) else {
                    continue;
                };
                let texel = source[i - at * stride + there * stride];
                for (s, t) in sum.iter_mut().zip(texel) {
                    *s += weight * t;
                }
            }
            sum
        };
        (0..source.len()).into_par_iter().map(value).collect()
    };
    pass(&pass(map, true), false)
}

fn zip(a: &[[f64; 3]], b: &[[f64; 3]], f: impl Fn(f64, f64) -> f64) -> Map {
    let texel = |(a, b): (&[f64; 3], &[f64; 3])| std::array::from_fn(|c| f(a[c], b[c]));
    a.iter().zip(b).map(texel).collect()
}

/// Windowed moments of the two images.
struct Moments {
    mean: Map,
    target_mean: Map,
    /// Windowed means of image^2, target^2 and image * target.
    square: Map,
    target_square: Map,
    product: Map,
}

impl Moments {
    fn new(image: &[[f64; 3]], target: &[[f64; 3]], width: usize, height: usize) -> Moments {
        assert_eq!(image.len(), width * height, "image size");
        assert_eq!(target.len(), width * height, "target size");
        let windowed = |a: &[[f64; 3]], b: &[[f64; 3]]| blur(&zip(a, b, |x, y| x * y), width, height);
        Moments {
            mean: blur(image, width, height),
            target_mean: blur(target, width, height),
            square: windowed(image, image),
            target_square: windowed(target, target),
            product: windowed(image, target),
        }
    }

    /// SSIM of one value and its derivatives by mean, square and product.
    fn ssim(&self, i: usize, c: usize) -> (f64, [f64; 3]) {
        let (m, n) = (self.mean[i][c], self.target_mean[i][c]);
        let variances = self.square[i][c] - m * m + self.target_square[i][c] - n * n;
        let covariance = self.product[i][c] - m * n;
        let (a, b) = (2.0 * m * n + C1, 2.0 * covariance + C2);
        let (d, e) = (m * m + n * n + C1, variances + C2);
        let ssim = a * b / (d * e);
        let by_square = -ssim / e;
        let by_product = 2.0 * a / (d * e);
        // The mean enters a and d, and through the variance and the covariance e and b.
        let by_mean = 2.0 * n * b / (d * e) - 2.0 * m * ssim / d - 2.0 * m * by_square - n * by_product;
        (ssim, [by_mean, by_square, by_product])
    }
}

/// SSIM per pixel and channel.
pub fn ssim_map(image: &[[f64; 3]], target: &[[f64; 3]], width: usize, height: usize) -> Map {
    let moments = Moments::new(image, target, width, height);
    (0..image.len()).map(|i| std::array::from_fn(|c| moments.ssim(i, c).0)).collect()
}

/// Gradient by the image of sum(v_map * ssim_map).
pub fn ssim_backward(image: &[[f64; 3]], target: &[[f64; 3]], width: usize, height: usize, v_map: &[[f64; 3]]) -> Map {
    let moments = Moments::new(image, target, width, height);
    let mut by = [(); 3].map(|()| vec![[0.0; 3]; image.len()]);
    for i in 0..image.len() {
        for c in 0..3 {
            let (_, derivatives) = moments.ssim(i, c);
            for (map, d) in by.iter_mut().zip(derivatives) {
                map[i][c] = v_map[i][c] * d;
            }
        }
    }
    let [v_mean, v_square, v_product] = by.map(|map| blur(&map, width, height));
    let pixel = |i: usize| {
        std::array::from_fn(|c| v_mean[i][c] + 2.0 * image[i][c] * v_square[i][c] + target[i][c] * v_product[i][c])
    };
    (0..image.len()).map(pixel).collect()
}

/// A photo over a background, by as much as `cover` leaves of it.
pub fn over(photo: &[[f64; 3]], cover: &[f64], background: [f64; 3]) -> Map {
    let pixel = |(p, cover): (&[f64; 3], &f64)| std::array::from_fn(|c| cover * p[c] + (1.0 - cover) * background[c]);
    photo.iter().zip(cover).map(pixel).collect()
}

/// Mean of a map over pixels and channels.
pub fn mean(map: &[[f64; 3]]) -> f64 {
    map.as_flattened().iter().sum::<f64>() / (3 * map.len()) as f64
}

/// Mean absolute difference over pixels and channels.
pub fn l1(image: &[[f64; 3]], target: &[[f64; 3]]) -> f64 {
    mean(&zip(image, target, |a, b| (a - b).abs()))
}

/// Mean SSIM over pixels and channels.
pub fn ssim(image: &[[f64; 3]], target: &[[f64; 3]], width: usize, height: usize) -> f64 {
    mean(&ssim_map(image, target, width, height))
}

/// (1 - lambda) L1 + lambda (1 - SSIM).
pub fn image_loss(image: &[[f64; 3]], target: &[[f64; 3]], width: usize, height: usize, lambda: f64) -> f64 {
    (1.0 - lambda) * l1(image, target) + lambda * (1.0 - ssim(image, target, width, height))
}

/// Gradient of `image_loss` by the image. Where a value equals its target L1 passes nothing.
pub fn image_loss_backward(image: &[[f64; 3]], target: &[[f64; 3]], width: usize, height: usize, lambda: f64) -> Map {
    let share = 1.0 / (3 * image.len()) as f64;
    let v_map = vec![[-lambda * share; 3]; image.len()];
    let by_ssim = ssim_backward(image, target, width, height, &v_map);
    let sign = |d: f64| if d == 0.0 { 0.0 } else { d.signum() };
    let by_l1 = zip(image, target, |a, b| (1.0 - lambda) * share * sign(a - b));
    zip(&by_l1, &by_ssim, |a, b| a + b)
}
