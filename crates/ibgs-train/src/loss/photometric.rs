//! The photometric loss (method.md section 7): SSIM of the photo and the source photos warped to it, as a burn autodiff
//! operation.

use super::{Loss, LossInputs};
use crate::autodiff::unary;
use crate::tensor::{bind, empty_like};
use burn::tensor::Tensor;
use burn_cubecl::tensor::CubeTensor;
use ibgs_core::config::schedule::Schedule;
use ibgs_core::gpu::pool::{Lease, Pool};
use ibgs_core::gpu::{Buffer, Gpu, GpuError, Pass};
use ibgs_core::sources::{DevicePhoto, MAX_VISIBLE};
use ibgs_shaders::TILE;
use ibgs_shaders::bindings::{LossMeanBindings, PhotometricLossBackwardBindings, PhotometricLossBindings};
use ibgs_shaders::types::{LossParams, MeanParams};
use std::sync::Arc;

/// Scratch memory of one image size and number of visible sources.
#[derive(Debug)]
struct Scratch {
    /// Derivatives of SSIM by its windowed moments, a buffer a source: together they could outgrow one binding.
    moments: Vec<Buffer<f32>>,
    partials: Buffer<[f32; 2]>,
    /// (loss, pixels and channels that count).
    stats: Buffer<f32>,
    pixels: usize,
    groups: usize,
}

/// `weight x mean over visible (source, pixel) of 1 - SSIM_p(photo, warped)`; owns its scratch memory.
///
/// A pair counts when the source is visible at the pixel, its depth agrees, and the photo is valid there. Around
/// it SSIM sees the warped image where that counts, elsewhere the photo; masked parts of the photo are zero in both, as
/// the outside of the image is.
#[derive(Debug)]
pub struct PhotometricLoss {
    gpu: Arc<Gpu>,
    pool: Arc<Pool<Scratch>>,
    /// Weight of the loss.
    pub weight: f32,
    /// It is part of the iterations at multiples of this.
    every: u32,
}

#[derive(Clone, Debug)]
struct Saved {
    gpu: Arc<Gpu>,
    warped: CubeTensor,
    seen: Buffer<u32>,
    target: DevicePhoto,
    params: LossParams,
    scratch: Arc<Lease<Scratch>>,
}

impl Saved {
    fn visible(&self) -> usize {
        self.warped.meta.shape()[0]
    }

    fn backward(&self, v_loss: &CubeTensor) -> CubeTensor {
        let gpu = &*self.gpu;
        let v_warped = empty_like(&self.warped, self.warped.meta.shape());
        let (warped, upstream, out) = (bind(&self.warped), bind(v_loss), bind(&v_warped));
        let mut pass = Pass::new(gpu, "photometric loss backward");
        let [x, y] = self.params.tiles;
        for (source, moments) in (0..).zip(&self.scratch.moments[..self.visible()]) {
            let buffers = PhotometricLossBackwardBindings {
                warped: &warped,
                seen: &self.seen,
                photo: &self.target.texels,
                moments,
                stats: &self.scratch.stats,
                v_loss: &upstream,
                v_warped: &out,
            };
            let params = LossParams { visible_index: source, ..self.params };
            pass.grid(&buffers, &params, [x, y, 3]);
        }
        pass.submit();
        v_warped
    }
}

impl PhotometricLoss {
    /// A loss with this weight.
    pub fn new(gpu: Arc<Gpu>, weight: f32) -> Self {
        Self { gpu, pool: Arc::default(), weight, every: 1 }
    }

    /// The same as a part of the iterations at multiples of `every`.
    pub fn every(self, every: u32) -> Self {
        Self { every, ..self }
    }

    fn scratch(&self, visible: usize, pixels: usize, groups: usize) -> Result<Lease<Scratch>, GpuError> {
        let fits = |s: &Scratch| s.moments.len() >= visible && s.pixels >= pixels && s.groups >= groups;
        let moments = || self.gpu.allocate("SSIM moments of the warped images", 9 * pixels);
        let make = || {
            Ok(Scratch {
                moments: (0..visible).map(|_| moments()).collect::<Result<_, _>>()?,
                partials: self.gpu.allocate("photometric loss sums", groups)?,
                stats: self.gpu.allocate("photometric loss statistics", 2)?,
                pixels,
                groups,
            })
        };
        self.pool.lease_or(fits, make)
    }

    fn forward(
        &self,
        warped: CubeTensor,
        seen: &Buffer<u32>,
        target: &DevicePhoto,
    ) -> Result<(CubeTensor, Saved), GpuError> {
        let gpu = &*self.gpu;
        let [width, height] = target.size;
        let pixels = (width * height) as usize;
        let visible = warped.meta.shape()[0];
        assert_eq!(warped.meta.shape()[1..], [pixels, 4], "warped images and photo differ in size");
        assert!((1..=MAX_VISIBLE as usize).contains(&visible), "number of warped images");
        gpu.check_size("warped images", 16 * (visible * pixels) as u64)?;
        let tiles = [width.div_ceil(TILE), height.div_ceil(TILE)];
        let params = LossParams { size: target.size, tiles, lambda: self.weight, ..LossParams::default() };
        let groups = 3 * visible as u32 * tiles[0] * tiles[1];
        let scratch = self.scratch(visible, pixels, groups as usize)?;
        let loss = empty_like(&warped, &[1]);
        let (bound_warped, bound_loss) = (bind(&warped), bind(&loss));
        let mut pass = Pass::new(gpu, "photometric loss");
        let (photo, partials) = (&target.texels, &scratch.partials);
        for (source, moments) in (0..).zip(&scratch.moments[..visible]) {
            let buffers = PhotometricLossBindings { warped: &bound_warped, seen, photo, moments, partials };
            let params = LossParams { visible_index: source, ..params };
            pass.grid(&buffers, &params, [tiles[0], tiles[1], 3]);
        }
        let mean = MeanParams { count: groups, weight: self.weight };
        pass.groups(&LossMeanBindings { partials, loss: &bound_loss, stats: &scratch.stats }, &mean, 1);
        pass.submit();
        let (gpu, seen, target) = (self.gpu.clone(), seen.clone(), target.clone());
        Ok((loss, Saved { gpu, warped, seen, target, params, scratch: Arc::new(scratch) }))
    }

    /// Loss `[1]` of tracked warped images `[V, P, 4]` (V at most 4; colour and cosine, pixels row by row), 0 where
    /// nothing is visible. `seen` holds `[P]` u32: byte m is the number of visible source m, 255 where there
    /// is none. The gradient reaches the colours of the pairs that count; that of the cosine is 0.
    ///
    /// # Errors
    /// Not enough memory.
    ///
    /// # Panics
    /// When warped images and photo differ in size, or the images are not on the autodiff graph: bugs of ours.
    pub fn tracked(&self, warped: Tensor<3>, seen: &Buffer<u32>, target: &DevicePhoto) -> Result<Tensor<1>, GpuError> {
        unary(warped, |warped| {
            let (loss, saved) = self.forward(warped, seen, target)?;
            Ok((loss, move |v_loss: &CubeTensor| Some(saved.backward(v_loss))))
        })
    }
}

impl Loss for PhotometricLoss {
    fn uses_burn(&self) -> bool {
        false
    }

    fn reads_sources(&self, iteration: u32, _: &Schedule) -> bool {
        iteration.is_multiple_of(self.every) && self.weight > 0.0
    }

    fn of(&self, inputs: &LossInputs<'_>) -> Result<Option<Tensor<1>>, GpuError> {
        let warped = inputs.warped.filter(|_| self.reads_sources(inputs.iteration, inputs.schedule));
        warped.map(|warped| self.tracked(warped.colors.clone(), &warped.visible, inputs.target)).transpose()
    }
}

/// Against the twin, forward and backward.
#[cfg(test)]
mod kernels {
    use super::PhotometricLoss;
    use crate::tensor::{device, values};
    use burn::tensor::{Tensor, TensorData};
    use ibgs_core::dataset::Photo;
    use ibgs_core::sources::DevicePhoto;
    use ibgs_reference::gpu::gpu;
    use ibgs_reference::image_loss::Map;
    use ibgs_reference::photometric_loss::{Masked, photometric_loss, photometric_loss_backward};
    use ibgs_reference::random_scene::random_image;
    use ibgs_reference::relative_error;

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
            let photo: Map =
                random_image(width, height, 0.0, 1.0, seed).into_iter().map(|p| p.map(quantised)).collect();
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
}
