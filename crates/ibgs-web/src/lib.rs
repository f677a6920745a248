//! ibgs in a browser, as a module for JavaScript:
//!
//! ```js
//! import init, { open } from "./ibgs_web.js";
//! await init();
//! const scene = await open(new Uint8Array(await (await fetch("scene.ibgs")).arrayBuffer()));
//! const [width, height] = scene.size(0);
//! const pixels = await scene.render(0, "final");
//! context.putImageData(new ImageData(pixels, width, height), 0, 0);
//! ```
//!
//! [`viewer::view`] shows the viewer in a canvas: the same as `ibgs view` opens in a window, without files and training.
//!
//! It is empty for any other target than wasm32.

#![cfg(target_arch = "wasm32")]
#![forbid(unsafe_code)]

pub mod viewer;

use ibgs_core::gpu::{Gpu, device_descriptor};
use ibgs_core::model::{Model, ModelOptions};
use ibgs_core::render::Renderer;
use ibgs_core::residual::Precision;
use ibgs_core::scene::Harmonics;
use js_sys::{Error, Uint8ClampedArray};
use std::path::Path;
use std::sync::Arc;
use wasm_bindgen::prelude::wasm_bindgen;

/// Name of the bundle in messages.
const BUNDLE: &str = "the bundle";

/// A model on the browser's GPU.
#[wasm_bindgen]
#[derive(Debug)]
pub struct Scene {
    model: Model,
    renderer: Renderer,
    gpu: Arc<Gpu>,
}

/// Opens a bundle, given by its bytes.
///
/// # Errors
/// The browser has no WebGPU, its adapter lacks a limit, or the bundle is damaged.
#[wasm_bindgen]
pub async fn open(bundle: Vec<u8>) -> Result<Scene, Error> {
    console_error_panic_hook::set_once();
    let gpu = gpu().await?;
    let mut model = Model::from_bundle(&bundle, Path::new(BUNDLE), &options()).map_err(sentence)?;
    let renderer = model.renderer(&gpu).map_err(sentence)?;
    gpu.check().map_err(sentence)?;
    Ok(Scene { model, renderer, gpu })
}

/// How the page opens its bundle.
fn options() -> ModelOptions {
    ModelOptions { precision: Precision::Auto, harmonics: Harmonics::Half, ..ModelOptions::default() }
}

async fn gpu() -> Result<Arc<Gpu>, Error> {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = wgpu::Backends::BROWSER_WEBGPU;
    let instance = wgpu::Instance::new(descriptor);
    let adapter = instance.request_adapter(&wgpu::RequestAdapterOptions::default()).await;
    let adapter =
        adapter.map_err(|_| Error::new("this browser offers no WebGPU adapter; try a current Chrome or Edge"))?;
    let device = adapter.request_device(&device_descriptor(&adapter)).await;
    let (device, queue) = device.map_err(sentence)?;
    let gpu = Gpu::from_wgpu(instance, adapter, device, queue).map_err(sentence)?;
    gpu.watch();
    Ok(gpu)
}

fn sentence(error: impl std::error::Error + 'static) -> Error {
    Error::new(&ibgs_core::sentence(&error))
}

#[wasm_bindgen]
impl Scene {
    /// Names of its views.
    pub fn names(&self) -> Vec<String> {
        self.model.cameras.iter().map(|record| record.name.clone()).collect()
    }

    /// Width and height of a view in pixels, by its place in the names.
    ///
    /// # Errors
    /// There is no such view.
    pub fn size(&self, view: usize) -> Result<Vec<u32>, Error> {
        let camera = self.camera(view)?;
        Ok(vec![camera.width, camera.height])
    }

    /// Renders a view. `mode` is `final` or `base`; a model without a network has its base image for both. RGBA, row by row.
    ///
    /// # Errors
    /// There is no such view or mode, the GPU has no memory left, or the device is lost.
    pub async fn render(&self, view: usize, mode: String) -> Result<Uint8ClampedArray, Error> {
        let camera = self.camera(view)?;
        let wants_final = match &*mode {
            "final" => true,
            "base" => false,
            other => return Err(Error::new(&format!("`{other}` is neither `final` nor `base`"))),
        };
        let frame = self.renderer.render_async(camera, |_| Ok(())).await.map_err(sentence)?;
        let image = if wants_final { frame.image_async().await.map_err(sentence)? } else { None };
        let image = match image {
            Some(image) => image,
            None => frame.base_async().await.map_err(sentence)?,
        };
        self.gpu.check().map_err(sentence)?;
        let rgba: Vec<u8> = image.to_rgb8().chunks_exact(3).flat_map(|c| [c[0], c[1], c[2], 255]).collect();
        Ok(Uint8ClampedArray::from(&rgba[..]))
    }
}

impl Scene {
    fn camera(&self, view: usize) -> Result<&ibgs_core::camera::Camera, Error> {
        let record = self.model.cameras.get(view);
        let missing = || Error::new(&format!("there is no view {view}: the model has {}", self.model.cameras.len()));
        record.map(|record| &record.camera).ok_or_else(missing)
    }
}
