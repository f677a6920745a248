//! Writes a part of a frame into a texture for the screen, without a copy through the host.

use crate::gpu::{Buffer, Gpu, GpuError, Pass};
use crate::picture::viridis;
use crate::render::Frame;
use crate::sources::DevicePhoto;
use ibgs_shaders::Presented;
use ibgs_shaders::bindings::PresentBindings;
use ibgs_shaders::types::PresentParams;
use std::sync::Arc;

/// A part of a frame, in the colours of [`Picture`](crate::picture::Picture).
#[derive(Clone, Copy, Debug)]
pub enum Shown<'a> {
    /// The final image; the base where the model has no network.
    Final,
    /// The base image.
    Base,
    /// Final minus base image around grey, amplified by this factor.
    Residual(f32),
    /// Median depth: depth of the brightest and of the darkest colour, in scene units.
    Depth([f32; 2]),
    /// Normal map.
    Normal,
    /// How many sources see a pixel's point; this number has the brightest colour.
    Visibility(u32),
    /// Final image minus a photo of the frame's size around grey, amplified by this factor.
    Difference(&'a DevicePhoto, f32),
    /// A photo of the frame's size.
    Photo(&'a DevicePhoto),
    /// The same, dark and grey but for what masks hide.
    Hidden(&'a DevicePhoto),
}

/// Puts frames into textures; owns the memory between.
#[derive(Debug)]
pub struct Presenter {
    gpu: Arc<Gpu>,
    palette: Buffer<u32>,
    pixels: Option<Buffer<u32>>,
}

/// What the kernel reads; the frame keeps the memory.
struct Inputs {
    mode: Presented,
    values: Buffer<f32>,
    others: Option<Buffer<f32>>,
    words: Option<Buffer<u32>>,
}

impl Presenter {
    /// A presenter without any memory but its palette.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn new(gpu: Arc<Gpu>) -> Result<Self, GpuError> {
        let color = |i: u32| {
            let [r, g, b] = viridis(i as f32 / 255.0);
            u32::from_le_bytes([r, g, b, 255])
        };
        let palette: Vec<u32> = (0..256).map(color).collect();
        Ok(Self { palette: gpu.upload("palette", &palette)?, pixels: None, gpu })
    }

    /// Writes a part of the frame into an RGBA8 texture of the frame's size. A part that the frame does not have is black.
    ///
    /// # Errors
    /// Not enough memory.
    ///
    /// # Panics
    /// When texture, photo and frame differ in size: a bug of ours.
    pub fn present(&mut self, frame: &Frame, shown: &Shown, texture: &wgpu::Texture) -> Result<(), GpuError> {
        let size = [frame.camera().width, frame.camera().height];
        assert_eq!([texture.width(), texture.height()], size, "texture and frame differ in size");
        let gpu = self.gpu.clone();
        let mut pass = Pass::new(&gpu, "present");
        let (pixels, stride) = self.record(&mut pass, frame, shown)?;
        pass.copy_to_texture(&pixels, stride, texture);
        pass.submit();
        Ok(())
    }

    /// The same picture on the host: RGB, row by row, 8 bits a channel.
    ///
    /// # Errors
    /// Not enough memory, or the device is lost.
    ///
    /// # Panics
    /// When photo and frame differ in size: a bug of ours.
    pub fn picture(&mut self, frame: &Frame, shown: &Shown) -> Result<Vec<u8>, GpuError> {
        let size = [frame.camera().width, frame.camera().height];
        let gpu = self.gpu.clone();
        let mut pass = Pass::new(&gpu, "present");
        let (pixels, stride) = self.record(&mut pass, frame, shown)?;
        pass.submit();
        let words = self.gpu.read(&pixels, stride as usize * size[1] as usize)?;
        let rows = words.chunks_exact(stride as usize).map(|row| &row[..size[0] as usize]);
        let rgb = |word: &u32| {
            let [r, g, b, _] = word.to_le_bytes();
            [r, g, b]
        };
        Ok(rows.flatten().flat_map(rgb).collect())
    }

    /// Records the picture; returns where it will lie, and pixels from one of its rows to the next.
    fn record(&mut self, pass: &mut Pass, frame: &Frame, shown: &Shown) -> Result<(Buffer<u32>, u32), GpuError> {
        let size = [frame.camera().width, frame.camera().height];
        // Rows of copies into textures begin at multiples of 256 bytes.
        let stride = size[0].next_multiple_of(64);
        let words = stride as usize * size[1] as usize;
        if self.pixels.as_ref().is_none_or(|pixels| pixels.rows() < words) {
            self.pixels = None;
            self.pixels = Some(self.gpu.allocate("screen", words)?);
        }
        let pixels = self.pixels.clone().expect("just made");
        let (mut range, mut most, mut gain) = ([0.0; 2], 1, 1.0);
        match *shown {
            // The device has local units.
            Shown::Depth(wanted) => range = wanted.map(|z| (f64::from(z) / frame.space.scale) as f32),
            Shown::Visibility(wanted) => most = wanted.max(1),
            Shown::Residual(wanted) | Shown::Difference(_, wanted) => gain = wanted,
            _ => {}
        }
        match inputs(frame, shown) {
            Some(inputs) => {
                let params = PresentParams { size, stride, mode: inputs.mode as u32, range, most, gain };
                let values = &inputs.values;
                let others = inputs.others.as_ref().unwrap_or(values);
                // A mode without words does not look at them.
                let words = &inputs.words.unwrap_or_else(|| values.cast());
                let buffers = PresentBindings { values, others, words, palette: &self.palette, pixels: &pixels };
                pass.linear(&buffers, &params, size[0] as usize * size[1] as usize);
            }
            None => pass.clear(&pixels),
        }
        Ok((pixels, stride))
    }
}

fn inputs(frame: &Frame, shown: &Shown) -> Option<Inputs> {
    let base = || frame.base_memory().clone();
    let image = || frame.image_memory().cloned();
    let plain = |mode, values| Inputs { mode, values, others: None, words: None };
    let photo = |target: &DevicePhoto| {
        let size = [frame.camera().width, frame.camera().height];
        assert_eq!(target.size, size, "photo and frame differ in size");
        Some(target.texels.clone())
    };
    Some(match shown {
        Shown::Final => plain(Presented::Colors, image().unwrap_or_else(base)),
        Shown::Base => plain(Presented::Colors, base()),
        Shown::Residual(_) => Inputs { others: Some(base()), ..plain(Presented::Residual, image()?) },
        Shown::Depth(_) => plain(Presented::Depth, frame.surface()?.median_depth.clone()),
        Shown::Normal => plain(Presented::Normal, frame.surface()?.normal_map.clone()),
        Shown::Visibility(_) => {
            Inputs { words: Some(frame.seen()?.visible.clone()), ..plain(Presented::Visibility, base()) }
        }
        Shown::Difference(target, _) => {
            Inputs { words: photo(target), ..plain(Presented::Difference, image().unwrap_or_else(base)) }
        }
        Shown::Photo(target) => Inputs { words: photo(target), ..plain(Presented::Photo, base()) },
        Shown::Hidden(target) => Inputs { words: photo(target), ..plain(Presented::Hidden, base()) },
    })
}
