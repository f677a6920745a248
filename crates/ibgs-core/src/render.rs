//! `render_view`: the one path that render, eval and the viewer use.

use crate::camera::Camera;
use crate::gpu::buffer::primitive;
use crate::gpu::{Gpu, GpuError};
use crate::raster::{RasterView, Rasterizer};
use crate::scene::Splats;

/// A rendered image on the host.
#[derive(Clone, Debug)]
pub struct Rendered {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// RGB, row by row, not clamped.
    pub rgb: Vec<f32>,
}

impl Rendered {
    /// Clamped and rounded to 8 bits a channel.
    pub fn to_rgb8(&self) -> Vec<u8> {
        self.rgb.iter().map(|v| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8).collect()
    }
}

/// Renders a model from a camera and reads the image back.
///
/// # Errors
/// Not enough memory, or the device is lost.
pub fn render_view(
    raster: &Rasterizer,
    splats: &Splats,
    camera: &Camera,
    background: [f32; 3],
) -> Result<Rendered, GpuError> {
    let mut view = RasterView::new(*camera, splats.sh_degree());
    view.background = background;
    let image = primitive(raster.render(splats, &view)?);
    let rgb = raster.gpu().read(&Gpu::bind(&image), (camera.width * camera.height * 3) as usize)?;
    Ok(Rendered { width: camera.width, height: camera.height, rgb })
}
