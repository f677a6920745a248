//! What the start page holds.

use crate::dialogs::Dialog;
use crate::photos_form::PhotosForm;
use crate::preparing::Preparing;
use crate::recents::Recents;
use crate::train_form::{PathField, TrainForm};
use eframe::egui::{ColorImage, Context, TextureHandle, TextureOptions};
use std::path::PathBuf;

/// A render of the demo scene.
const PICTURE: &[u8] = include_bytes!("../assets/demo.jpg");

/// What the start page holds.
pub struct Start {
    /// It is what the window shows.
    pub shown: bool,
    /// A path that is being typed.
    pub address: PathField,
    pub photos: PhotosForm,
    pub preparing: Preparing,
    pub form: TrainForm,
    /// The form for photos, or that for a training, is brought into sight.
    pub finds_photos: bool,
    pub finds_form: bool,
    /// The field for a path is to be typed into.
    pub finds_address: bool,
    pub dialog: Dialog,
    pub recents: Recents,
    picture: Option<TextureHandle>,
}

impl Start {
    /// An empty page; `demo_iterations` is the default of the demo scene.
    pub fn new(demo_iterations: u32) -> Self {
        Self {
            shown: true,
            address: PathField::default(),
            photos: PhotosForm::default(),
            preparing: Preparing::default(),
            form: TrainForm::new(demo_iterations),
            finds_photos: false,
            finds_form: false,
            finds_address: false,
            dialog: Dialog::default(),
            recents: Recents::default(),
            picture: None,
        }
    }

    /// Shows the page.
    pub fn show(&mut self) {
        self.shown = true;
        self.recents.forget();
    }

    /// Shows the page with a form for these photos.
    pub fn ask_about_photos(&mut self, photos: PathBuf) {
        self.photos.set_input(photos);
        self.show();
        self.finds_photos = true;
    }

    /// Shows the page with a form for a training on this scene.
    pub fn ask_about(&mut self, scene: PathBuf) {
        self.form.set_scene(scene);
        self.show();
        self.finds_form = true;
    }

    /// Nothing of it is still being loaded.
    pub fn is_complete(&self) -> bool {
        self.recents.is_complete()
    }

    /// The picture at its top.
    pub fn picture(&mut self, ctx: &Context) -> Option<&TextureHandle> {
        if self.picture.is_none() {
            let picture = image::load_from_memory(PICTURE).ok()?.into_rgba8();
            let size = [picture.width() as usize, picture.height() as usize];
            let picture = ColorImage::from_rgba_unmultiplied(size, &picture);
            self.picture = Some(ctx.load_texture("demo scene", picture, TextureOptions::LINEAR));
        }
        self.picture.as_ref()
    }
}
