//! The viewer in a canvas of the page.

use crate::sentence;
use anyhow::{Result, bail};
use ibgs_core::gpu::Gpu;
use ibgs_core::model::Model;
use ibgs_core::output::cameras::{CameraRecord, Split};
use ibgs_core::render::Renderer;
use ibgs_viewer::{Content, Open, Opened, Outcome, Scene, View, Wanted};
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Arc;
use wasm_bindgen::JsValue;
use web_sys::HtmlCanvasElement;

/// A page opens what it gives, and nothing else.
struct Closed;

impl Open for Closed {
    fn open(&self, _: &Wanted, _: &Arc<Gpu>, _: &dyn Fn(&str)) -> Result<Outcome> {
        bail!("a browser opens no files; load the page with another bundle");
    }
}

/// Shows a model for as long as the page lives.
pub async fn show(canvas: HtmlCanvasElement, gpu: Arc<Gpu>, model: Model, renderer: Renderer) -> Result<(), JsValue> {
    let photos = model.training_photos().map_err(sentence)?;
    let photos: HashMap<_, _> = model.training_views().iter().map(|record| record.name.clone()).zip(photos).collect();
    let view = |record: &CameraRecord| {
        let size = (record.camera.width, record.camera.height);
        let photo = photos.get(&record.name).filter(|photo| (photo.width, photo.height) == size);
        View {
            name: record.name.clone(),
            camera: record.camera,
            held_out: record.split == Some(Split::Test),
            photo: photo.cloned(),
        }
    };
    let scene = Scene {
        title: String::new(),
        path: None,
        views: model.cameras.iter().map(view).collect(),
        points: Vec::new(),
        pictures: PathBuf::new(),
        model: None,
    };
    let content = Content::Model(Arc::new(renderer.showing_surface()));
    let first = Outcome::Opened(Box::new(Opened { scene, content }));
    ibgs_viewer::run_in(canvas, gpu, Closed, Some(first)).await
}
