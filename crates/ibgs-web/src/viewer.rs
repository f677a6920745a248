//! The viewer in a canvas of the page.

use crate::{BUNDLE, gpu, options, sentence};
use anyhow::{Result, bail};
use ibgs_core::gpu::Gpu;
use ibgs_core::model::Model;
use ibgs_viewer::{Content, Open, OpenRequest, Opened, Outcome, Scene, Status, View};
use js_sys::Error;
use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;
use wasm_bindgen::JsValue;
use wasm_bindgen::prelude::wasm_bindgen;
use web_sys::HtmlCanvasElement;

/// A page opens what it gives, and nothing else.
struct Closed;

impl Open for Closed {
    fn open(&self, _: &OpenRequest, _: &Arc<Gpu>, _: &Status<'_>) -> Result<Outcome> {
        bail!("a browser opens no files; load the page with another bundle");
    }
}

/// A viewer that runs in a canvas.
#[wasm_bindgen]
pub struct Viewer {
    runner: ibgs_viewer::WebRunner,
    gpu: Arc<Gpu>,
}

/// Shows a bundle in a canvas, given by its bytes, or by its beginning (`isStart`): that gives the base image, until
/// [`Viewer::complete`] brings the rest. `undefined` where the beginning is too short.
///
/// # Errors
/// As [`crate::open`], or the canvas cannot be drawn into.
#[wasm_bindgen]
pub async fn view(canvas: HtmlCanvasElement, bundle: Vec<u8>, is_start: bool) -> Result<Option<Viewer>, JsValue> {
    console_error_panic_hook::set_once();
    let options = options();
    let model = match is_start {
        true => Model::from_bundle_start(&bundle, Path::new(BUNDLE), &options).map_err(sentence)?,
        false => Some(Model::from_bundle(&bundle, Path::new(BUNDLE), &options).map_err(sentence)?),
    };
    drop(bundle);
    let Some(model) = model else { return Ok(None) };
    let gpu = gpu().await?;
    let first = Outcome::Opened(Box::new(opened(model, &gpu, !is_start)?));
    let runner = ibgs_viewer::run_in(canvas, gpu.clone(), Closed, Some(first)).await?;
    Ok(Some(Viewer { runner, gpu }))
}

#[wasm_bindgen]
impl Viewer {
    /// Shows the whole bundle in place of its beginning.
    ///
    /// # Errors
    /// As [`crate::open`].
    pub fn complete(&self, bundle: &[u8]) -> Result<(), Error> {
        let model = Model::from_bundle(bundle, Path::new(BUNDLE), &options()).map_err(sentence)?;
        let opened = opened(model, &self.gpu, true)?;
        if let Some(mut viewer) = self.runner.app_mut::<ibgs_viewer::Viewer>() {
            viewer.replace(opened);
        }
        Ok(())
    }

    /// Whether a picture of the scene has been rendered.
    #[wasm_bindgen(js_name = hasPicture)]
    pub fn has_picture(&self) -> bool {
        self.runner.app_mut::<ibgs_viewer::Viewer>().is_some_and(|viewer| viewer.has_picture())
    }

    /// The sentence of an error that the viewer shows.
    pub fn error(&self) -> Option<String> {
        self.runner.app_mut::<ibgs_viewer::Viewer>()?.error().map(str::to_owned)
    }

    /// Camera and mode as text for a link; `undefined` while nothing is open.
    pub fn link(&self) -> Option<String> {
        self.runner.app_mut::<ibgs_viewer::Viewer>()?.link()
    }

    /// Goes where such a text says.
    #[wasm_bindgen(js_name = followLink)]
    pub fn follow_link(&self, link: &str) {
        if let Some(mut viewer) = self.runner.app_mut::<ibgs_viewer::Viewer>() {
            viewer.follow_link(link);
        }
    }

    /// Whether the browser has taken the GPU away: then nothing more is shown.
    #[wasm_bindgen(js_name = isLost)]
    pub fn is_lost(&self) -> bool {
        self.gpu.check().is_err()
    }

    /// Ends the viewer and leaves the canvas.
    pub fn end(&self) {
        self.runner.destroy();
    }
}

/// A model as the viewer shows it.
fn opened(mut model: Model, gpu: &Arc<Gpu>, has_photos: bool) -> Result<Opened, Error> {
    let lacks_planes = model.gaussians.lacks_planes();
    let renderer = model.renderer(gpu).map_err(sentence)?;
    if lacks_planes {
        renderer.shape_planes();
    }
    gpu.check().map_err(sentence)?;
    let photos = match has_photos {
        true => model.training_photos().map_err(sentence)?,
        false => Vec::new(),
    };
    let photos: HashMap<_, _> = model.training_views().iter().map(|record| record.name.clone()).zip(photos).collect();
    let views = model.cameras.iter().map(|record| View::of(record, &photos)).collect();
    let scene = Scene { views, ..Scene::default() };
    Ok(Opened { scene, content: Content::Model(Arc::new(renderer.showing_surface())) })
}
