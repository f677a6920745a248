//! What the canvas shows, as a file.

use super::Viewer;
use ibgs_core::image_io::write_png;
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
