//! The viewer in a canvas of the page.

use crate::sentence;
use anyhow::{Result, bail};
use ibgs_core::gpu::Gpu;
use ibgs_viewer::{Content, Open, Opened, Outcome, Scene, View, Wanted};
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
pub async fn show(canvas: HtmlCanvasElement, opened: crate::Scene) -> Result<(), JsValue> {
    let crate::Scene { model, renderer, gpu } = opened;
    let photos = model.training_photos().map_err(sentence)?;
    let photos = model.training_views().iter().map(|record| record.name.clone()).zip(photos).collect();
    let views = model.cameras.iter().map(|record| View::of(record, &photos)).collect();
    let scene = Scene { views, ..Scene::default() };
    let content = Content::Model(Arc::new(renderer.showing_surface()));
    let first = Outcome::Opened(Box::new(Opened { scene, content }));
    ibgs_viewer::run_in(canvas, gpu, Closed, Some(first)).await
}
