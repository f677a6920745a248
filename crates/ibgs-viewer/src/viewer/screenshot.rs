//! What the canvas shows, as a file.

use super::Viewer;
use crate::thumbnails::small;
use eframe::egui::{Context, TextureOptions};
use ibgs_core::camera_path::Keyframe;
use ibgs_core::gpu::GpuError;
use ibgs_core::image_io::write_png;
use image::{DynamicImage, RgbImage};
use std::path::PathBuf;

impl Viewer {
    /// Writes what the canvas shows as a picture.
    pub fn screenshot(&mut self) {
        match self.write_screenshot() {
            Ok(Some(path)) => self.message = Some(format!("screenshot: {}", path.display())),
            Ok(None) => {}
            Err(error) => self.error = Some(ibgs_core::sentence(error.as_ref())),
        }
    }

    /// Keeps what the canvas shows as the picture of the keyframe that the camera stands at, where it has none.
    pub(crate) fn picture_keyframe(&mut self, ctx: &Context) -> Result<(), GpuError> {
        if !self.panels.shows_path || !self.canvas.is_settled() {
            return Ok(());
        }
        let here = self.navigator.keyframe();
        let is_here = |key: &Keyframe| {
            let same = key.position.abs_diff_eq(here.position, 1e-9 * self.extent);
            same && key.world_from_view.abs_diff_eq(here.world_from_view, 1e-9)
        };
        let editor = &self.panels.path;
        let mut keys = editor.path.keyframes.iter().zip(&editor.pictures);
        let Some(index) = keys.position(|(key, picture)| picture.is_none() && is_here(key)) else { return Ok(()) };
        let photo = self.photo()?;
        let Some((width, height, rgb)) = self.canvas.picture(self.mode, photo.as_ref())? else { return Ok(()) };
        let Some(whole) = RgbImage::from_raw(width, height, rgb) else { return Ok(()) };
        let small = small(&DynamicImage::from(whole).into_rgba8());
        self.panels.path.pictures[index] = Some(ctx.load_texture("keyframe", small, TextureOptions::LINEAR));
        Ok(())
    }

    fn write_screenshot(&mut self) -> anyhow::Result<Option<PathBuf>> {
        let photo = self.photo()?;
        let Some((width, height, mut rgb)) = self.canvas.picture(self.mode, photo.as_ref())? else { return Ok(None) };
        if let Some(other) = self.other
            && let Some((_, _, right)) = self.canvas.picture(other, photo.as_ref())?
        {
            let from = (self.divider * width as f32).round() as usize;
            let rows = rgb.chunks_exact_mut(3 * width as usize).zip(right.chunks_exact(3 * width as usize));
            rows.for_each(|(left, right)| left[3 * from..].copy_from_slice(&right[3 * from..]));
        }
        let folder = self.scene.as_ref().map(|scene| scene.pictures.join("screenshots")).unwrap_or_default();
        let path = loop {
            self.screenshots += 1;
            let path = folder.join(format!("{:04}.png", self.screenshots));
            if !path.exists() {
                break path;
            }
        };
        write_png(&path, width, height, &rgb)?;
        Ok(Some(path))
    }
}
