//! Films, stills and the pictures of keyframes.

use super::Viewer;
use crate::film::{Film, FilmTarget};
use crate::mode::Mode;
use crate::path_editor::Picture;
use crate::preparing::Bar;
use crate::thumbnails::{SIDE, small};
use crate::worker::{Command, KeyframeRequest};
use eframe::egui::{Context, TextureOptions};
use image::{DynamicImage, RgbImage};
use std::path::{Path, PathBuf};

/// A name that is free.
fn free(folder: &Path, name: impl Fn(u32) -> String) -> Option<PathBuf> {
    (1..).map(|n| folder.join(name(n))).find(|path| !path.exists())
}

impl Viewer {
    /// What a film shows: what was chosen, or what the window shows; without a photo all that compares with one is the final image.
    fn filmed(&self) -> Mode {
        self.panels.path.mode.unwrap_or(self.mode)
    }

    /// The film of the path, or a picture from where the camera is, under a name that is free.
    fn film_of(&self, is_still: bool) -> Option<Film> {
        let pictures = &self.scene.as_ref()?.pictures;
        let editor = &self.panels.path;
        let path = &editor.path;
        let target = match is_still {
            true => FilmTarget::Still(free(pictures, |n| format!("still-{n}.png"))?),
            false => FilmTarget::Frames(free(pictures, |n| format!("film-{n}"))?),
        };
        let cameras = match is_still {
            true => vec![self.navigator.keyframe().camera(path.width, path.height)],
            false => path.frames(),
        };
        let (mode, style, quality) = (self.filmed(), self.canvas.style, editor.quality);
        Some(Film { cameras, fps: path.fps, mode, style, quality, target })
    }

    /// Begins a film of the path, or a picture from where the camera is.
    pub(crate) fn film(&mut self, is_still: bool) {
        let Some(film) = self.film_of(is_still) else { return };
        self.panels.path.filming = Some(Bar::new("film", film.cameras.len()));
        self.panels.path.written = None;
        self.send(Command::Film(Box::new(film)));
    }

    /// Takes what was written of a film, which has ended.
    pub(crate) fn take_film(&mut self, written: Option<String>) {
        self.panels.path.filming = None;
        self.panels.path.written.clone_from(&written);
        self.message = written.or(self.message.take());
    }

    /// Asks for the picture of the next keyframe that has none, while nothing else is rendered.
    pub(crate) fn picture_keyframes(&mut self) {
        if !self.panels.shows_path || !self.canvas.is_settled() || self.panels.path.filming.is_some() {
            return;
        }
        let (mode, style) = (self.filmed(), self.canvas.style);
        let path = &mut self.panels.path;
        let size = [path.path.width, path.path.height];
        let Some(key) = path.lacks_picture() else { return };
        let longest = f64::from(size[0].max(size[1]));
        let [width, height] = size.map(|side| (f64::from(side * SIDE) / longest).round().max(1.0) as u32);
        let wanted = KeyframeRequest { key, camera: key.camera(width, height), mode, style };
        self.send(Command::Keyframe(Box::new(wanted)));
    }

    /// Takes what a keyframe shows.
    pub(crate) fn take_keyframe(&mut self, of: &KeyframeRequest, rgb: Option<Vec<u8>>, ctx: &Context) {
        let whole = rgb.and_then(|rgb| RgbImage::from_raw(of.camera.width, of.camera.height, rgb));
        let picture = whole.map_or(Picture::Failed, |whole| {
            let small = small(&DynamicImage::from(whole).into_rgba8());
            Picture::There(ctx.load_texture("keyframe", small, TextureOptions::LINEAR))
        });
        self.panels.path.take_picture(&of.key, &picture);
    }
}
