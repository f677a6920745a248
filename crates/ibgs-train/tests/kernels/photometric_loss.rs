//! The photometric loss against its twin, forward and backward.

use crate::common::values;
use burn::tensor::{Tensor, TensorData};
use ibgs_core::dataset::Photo;
use ibgs_core::sources::DevicePhoto;
use ibgs_reference::gpu::gpu;
use ibgs_reference::image_loss::Map;
use ibgs_reference::photometric_loss::{Masked, photometric_loss, photometric_loss_backward};
use ibgs_reference::random_scene::random_image;
use ibgs_reference::relative_error;
use ibgs_train::loss::PhotometricLoss;
use ibgs_train::tensor::device;

const WEIGHT: f64 = 0.3;

/// A photo, warped images that resemble it, and which pixels see what.
struct Case {
    width: u32,
    height: u32,
    photo: Map,
    valid: Vec<bool>,
    warped: Vec<Map>,
    visible: Vec<Vec<bool>>,
}

impl Case {
    fn new(width: u32, height: u32, sources: usize, seed: u64) -> Case {
        let quantised = |v: f64| (v * 255.0).round() / 255.0;
        let photo: Map = random_image(width, height, 0.0, 1.0, seed).into_iter().map(|p| p.map(quantised)).collect();
        let warp = |m: usize| -> Map {
            let noise = random_image(width, height, -0.4, 0.4, seed + 10 + m as u64);
            let blend = |(p, n): (&[f64; 3], &[f64; 3])| std::array::from_fn(|c| f64::from((p[c] + n[c]) as f32));
            photo.iter().zip(&noise).map(blend).collect()
        };
        // Slots fill in order: a later one is never fuller than an earlier one. Some pixels see nothing.
        let level = random_image(width, height, 0.0, 1.0, seed + 20);
        let visible = (0..sources).map(|m| level.iter().map(|v| v[0] > 0.15 + 0.3 * m as f64).collect()).collect();
        let valid = (0..photo.len()).map(|i| i % width as usize >= 3 || i % 5 != 0).collect();
        Case { width, height, warped: (0..sources).map(warp).collect(), photo, valid, visible }
    }

    fn masked(&self) -> Masked<'_> {
        let (width, height) = (self.width as usize, self.height as usize);
        Masked { photo: &self.photo, valid: &self.valid, width, height }
    }

    /// Loss and gradient `[V, P, 4]` on the GPU; the upstream gradient is 3.
    fn on_gpu(&self) -> (f64, Vec<f64>) {
        let gpu = gpu();
        let texel = |(p, valid): (&[f64; 3], &bool)| {
            let [r, g, b] = p.map(|v| (v * 255.0).round() as u8);
            [r, g, b, if *valid { 255 } else { 0 }]
        };
        let rgba = self.photo.iter().zip(&self.valid).flat_map(texel).collect();
        let target = DevicePhoto::upload(&gpu, &Photo { width: self.width, height: self.height, rgba }).unwrap();
        // A source whose depth does not agree is as good as none.
        let byte = |i: usize, m: usize| match self.visible.get(m) {
            Some(visible) if visible[i] => (2 - m as u8 % 3) | (i as u8 % 3) << 4,
            Some(_) if i % 2 == 1 => 2 | (3 + i as u8 % 12) << 4,
            _ => 255,
        };
        let word = |i: usize| u32::from_le_bytes(std::array::from_fn(|m| byte(i, m)));
        let seen: Vec<u32> = (0..self.photo.len()).map(word).collect();
        let seen = gpu.upload("seen", &seen).unwrap();
        // What stands where no source is visible must not matter.
        let row = |m: usize, i: usize| {
            let [r, g, b] = self.warped[m][i].map(|v| v as f32);
            if self.visible[m][i] { [r, g, b, 0.9] } else { [f32::NAN; 4] }
        };
        let (sources, pixels) = (self.warped.len(), self.photo.len());
        let flat: Vec<f32> = (0..sources).flat_map(|m| (0..pixels).flat_map(move |i| row(m, i))).collect();
        let leaf = Tensor::<3>::from_data(TensorData::new(flat, [sources, pixels, 4]), device(&gpu).unwrap());
        let leaf = leaf.autodiff().require_grad();
        let loss = PhotometricLoss::new(gpu.clone(), WEIGHT as f32).tracked(leaf.clone(), &seen, &target).unwrap();
        let mut grads = (loss.clone() * 3.0).backward();
        (values(loss.inner())[0], values(leaf.grad_remove(&mut grads).unwrap()))
    }

    fn check(&self, what: &str) {
        let (loss, gradient) = self.on_gpu();
        let expected = photometric_loss(&self.masked(), &self.warped, &self.visible, WEIGHT);
        let twin: Vec<f64> = photometric_loss_backward(&self.masked(), &self.warped, &self.visible, 3.0 * WEIGHT)
            .concat()
            .iter()
            .flat_map(|v| [v[0], v[1], v[2], 0.0])
            .collect();
        let error = relative_error(&gradient, &twin);
        println!("{what}: loss error {:.1e}, gradient error {error:.1e}", (loss - expected).abs());
        assert!((loss - expected).abs() <= 1e-6 + 1e-5 * expected, "{what}: {loss} against {expected}");
        assert!(error <= 1e-4, "{what}: gradient error {error:e}");
        for (i, (a, b)) in gradient.iter().zip(&twin).enumerate() {
            assert!(*b != 0.0 || *a == 0.0, "{what}: value {i} is {a} where the truth is zero");
        }
    }
}

#[test]
fn loss_and_gradient_follow_the_twin_at_every_size() {
    for (seed, (width, height, sources)) in
        (0..).zip([(1, 1, 1), (5, 3, 2), (13, 9, 3), (16, 16, 4), (33, 17, 3), (70, 50, 3)])
    {
        let case = Case::new(width, height, sources, seed);
        case.check(&format!("{width} x {height}, {sources} sources"));
    }
    let case = Case::new(33, 17, 3, 4);
    assert!(case.on_gpu().1.iter().any(|v| *v != 0.0), "a gradient there is");
}

#[test]
fn nothing_visible_costs_nothing() {
    let mut case = Case::new(20, 18, 2, 7);
    case.visible.iter_mut().for_each(|v| v.fill(false));
    let (loss, gradient) = case.on_gpu();
    assert_eq!(loss, 0.0);
    assert!(gradient.iter().all(|v| *v == 0.0));
}

#[test]
fn what_lies_under_the_mask_does_not_matter() {
    let case = Case::new(33, 17, 3, 8);
    let mut other = Case::new(33, 17, 3, 8);
    let hidden: Vec<usize> = (0..other.photo.len()).filter(|i| !other.valid[*i]).collect();
    for i in &hidden {
        other.photo[*i] = [0.2, 0.4, 0.6];
        other.warped.iter_mut().for_each(|w| w[*i] = [0.9, 0.1, 0.3]);
    }
    assert!(!hidden.is_empty());
    assert_eq!(case.on_gpu(), other.on_gpu());
}

/// A perfect warp costs nothing, however much of the photo it fills.
#[test]
fn the_photo_itself_costs_nothing() {
    let mut case = Case::new(40, 24, 2, 9);
    case.warped.iter_mut().for_each(|w| w.clone_from(&case.photo));
    let (loss, _) = case.on_gpu();
    assert!(loss.abs() < 1e-6, "{loss}");
}
