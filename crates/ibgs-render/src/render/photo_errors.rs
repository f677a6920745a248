//! How far the base image is from photos, by Gaussian.

use super::Renderer;
use crate::camera::Camera;
use crate::dataset::Photo;
use crate::ensemble::weights;
use crate::gpu::{GpuError, Pass};
use crate::raster::{Forward, Keep, RasterView, Rasterizer};

/// Sums over photos, for the mean squared error of the base image by Gaussian: the error of a pixel counts by the blending weight
/// that the Gaussian has there.
#[derive(Debug)]
pub struct PhotoErrors {
    /// One of its own: the memory for gradients goes with it.
    raster: Rasterizer,
    /// Weighted errors and weights of each Gaussian, those of the members of an ensemble one after the other.
    sums: Vec<[f64; 2]>,
}

impl PhotoErrors {
    /// Nothing is known yet of the Gaussians of a renderer.
    pub fn new(renderer: &Renderer) -> Self {
        let count = renderer.all().map(|member| member.splats.len()).sum();
        Self { raster: Rasterizer::new(renderer.gpu().clone()), sums: vec![[0.0; 2]; count] }
    }

    /// Adds a photo, which has the size of its camera; pixels with an alpha under one half do not count. The renderer is the one
    /// that it began with.
    ///
    /// # Errors
    /// Not enough memory, or the device is lost.
    ///
    /// # Panics
    /// When the photo or the renderer is another one: a bug of ours.
    pub fn add(&mut self, renderer: &Renderer, camera: &Camera, photo: &Photo) -> Result<(), GpuError> {
        assert_eq!([photo.width, photo.height], [camera.width, camera.height], "the size of a photo");
        let errors = squared(&self.base(renderer, camera)?, photo);
        let errors = renderer.gpu().upload("errors", &errors)?;
        let mut sums = self.sums.iter_mut();
        // A member may have lost all of its Gaussians.
        for member in renderer.all().filter(|member| !member.splats.is_empty()) {
            let forward = forward(&self.raster, member, camera, Keep::Gradients)?;
            let added = forward.weighted(renderer.gpu(), member.splats.len(), &errors)?;
            for ([error, weight, ..], sum) in added.into_iter().zip(sums.by_ref()) {
                *sum = [sum[0] + f64::from(error), sum[1] + f64::from(weight)];
            }
        }
        assert!(sums.next().is_none(), "the Gaussians of another renderer");
        Ok(())
    }

    /// The mean squared error of each Gaussian, over the colour's three channels from 0 to 1; no number where no photo sees it.
    pub fn means(&self) -> Vec<f32> {
        self.sums.iter().map(|[error, weight]| if *weight > 0.0 { (error / weight) as f32 } else { f32::NAN }).collect()
    }

    /// The base image of a view, RGB.
    fn base(&self, renderer: &Renderer, camera: &Camera) -> Result<Vec<f32>, GpuError> {
        let alike = renderer.alike;
        let [first, other] = weights(alike, renderer.all().count() - alike);
        let mut base = vec![0.0; 3 * camera.pixels()];
        for (number, member) in renderer.all().enumerate() {
            let forward = forward(&self.raster, member, camera, Keep::Image)?;
            let image = match member.exposures(camera, &[])? {
                Some(exposures) => {
                    let exposed = renderer.gpu().transient("exposed image", forward.image.rows())?;
                    let mut pass = Pass::new(renderer.gpu(), "exposure");
                    exposures.record(&mut pass, &forward, &exposed);
                    pass.submit();
                    exposed
                }
                None => forward.image,
            };
            let weight = if number < alike { first } else { other };
            let values = renderer.gpu().read(&image, base.len())?;
            base.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
        }
        Ok(base)
    }
}

/// The pass of one member, of which every tile intersection fits.
fn forward(raster: &Rasterizer, member: &Renderer, camera: &Camera, keep: Keep) -> Result<Forward, GpuError> {
    let view = RasterView { surface: None, ..member.view(&member.space().camera(camera)) };
    loop {
        let image = raster.image_memory(&view.camera)?;
        let forward = raster.forward(&member.splats, &view, keep, image)?;
        if raster.had_room(&forward)? {
            return Ok(forward);
        }
    }
}

/// The squared error of each pixel, then 1, or twice 0 where there is no photo; the third number is 0.
fn squared(base: &[f32], photo: &Photo) -> Vec<f32> {
    let pixel = |(base, &[r, g, b, alpha]): (&[f32; 3], &[u8; 4])| {
        let error = |c: usize| (base[c].clamp(0.0, 1.0) - f32::from([r, g, b][c]) / 255.0).powi(2);
        if alpha < 128 { [0.0; 3] } else { [(error(0) + error(1) + error(2)) / 3.0, 1.0, 0.0] }
    };
    base.as_chunks().0.iter().zip(photo.rgba.as_chunks().0).flat_map(pixel).collect()
}
