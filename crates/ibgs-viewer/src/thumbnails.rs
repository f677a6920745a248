//! Small pictures of the scene's photos, made when they are first seen.

use crate::View;
use eframe::egui::{Color32, ColorImage, Context, Painter, Pos2, Rect, TextureHandle, TextureOptions, pos2};
use ibgs_core::dataset::Photo;
use image::imageops::thumbnail;
use image::{Rgba, RgbaImage};
use std::collections::HashMap;
use std::time::Duration;

/// Longest side in pixels.
pub const SIDE: u32 = 192;
/// Thumbnails that are made in one go: the others come with the next ones.
const AT_ONCE: usize = 2;

/// After this, photos that are decoded in the meantime are looked for.
const LATER: Duration = Duration::from_millis(200);

/// The thumbnails made so far.
#[derive(Default)]
pub struct Thumbnails {
    made: HashMap<usize, TextureHandle>,
    /// Made since the beginning of the frame.
    now: usize,
}

fn of_photo(photo: &Photo) -> Option<ColorImage> {
    RgbaImage::from_raw(photo.width, photo.height, photo.rgba.clone()).map(|whole| small(&whole))
}

/// A picture made small, without its alpha.
pub fn small(whole: &RgbaImage) -> ColorImage {
    let share = f64::from(SIDE) / f64::from(whole.width().max(whole.height()));
    let side = |length: u32| ((f64::from(length) * share.min(1.0)).round() as u32).max(1);
    let mut small = thumbnail(whole, side(whole.width()), side(whole.height()));
    small.pixels_mut().for_each(|Rgba([_, _, _, a])| *a = 255);
    let size = [small.width() as usize, small.height() as usize];
    ColorImage::from_rgba_unmultiplied(size, &small)
}

/// Paints a picture as large as it fits into the middle of a room.
pub fn paint(painter: &Painter, picture: &TextureHandle, room: Rect) {
    let size = picture.size_vec2();
    let place = Rect::from_center_size(room.center(), size * (room.size() / size).min_elem());
    let whole = Rect::from_min_max(Pos2::ZERO, pos2(1.0, 1.0));
    painter.image(picture.id(), place, whole, Color32::WHITE);
}

impl Thumbnails {
    /// A new frame of the window begins.
    pub fn begin(&mut self) {
        self.now = 0;
    }

    /// The thumbnail of a view; none where it has no photo or its turn comes later.
    pub fn of(&mut self, ctx: &Context, index: usize, view: &View) -> Option<TextureHandle> {
        if let Some(made) = self.made.get(&index) {
            return Some(made.clone());
        }
        let photo = view.photo.as_ref()?;
        if self.now >= AT_ONCE {
            ctx.request_repaint();
            return None;
        }
        self.now += 1;
        let Some(pixels) = photo.pixels_if_there() else {
            photo.decode_ahead();
            ctx.request_repaint_after(LATER);
            return None;
        };
        let texture = ctx.load_texture(&view.name, of_photo(&pixels)?, TextureOptions::LINEAR);
        self.made.insert(index, texture.clone());
        Some(texture)
    }
}
