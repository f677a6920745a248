//! What the window adds to the time of a frame.

use crate::mode::{Mode, Style};
use crate::worker::{Command, Message, Request, Sheet, Worker};
use crate::{Content, Open, OpenRequest, Opened, Outcome, Scene, Status};
use anyhow::{Result, bail};
use eframe::egui;
use ibgs_core::camera::Camera;
use ibgs_core::gpu::Gpu;
use ibgs_core::render::Renderer;
use std::sync::Arc;
use web_time::Instant;

/// Medians over the frames, in milliseconds.
#[derive(Clone, Copy, Debug)]
pub struct FrameTimes {
    /// The renderer alone: from the call until the device has finished.
    pub alone: f64,
    /// The window's way: request to its thread, frame, and picture in a texture that the window can paint.
    pub in_window: f64,
}

struct Nothing;

impl Open for Nothing {
    fn open(&self, _: &OpenRequest, _: &Arc<Gpu>, _: &Status<'_>) -> Result<Outcome> {
        bail!("nothing is opened here")
    }
}

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times.get(times.len() / 2).copied().unwrap_or_default()
}

/// Times frames of these cameras, all of one size, each both ways in turn; the first tenth does not count.
///
/// # Errors
/// Not enough memory, or the device is lost.
pub fn measure(renderer: &Arc<Renderer>, cameras: &[Camera]) -> Result<FrameTimes> {
    let gpu = renderer.gpu().clone();
    let Some(Camera { width, height, .. }) = cameras.first().copied() else { bail!("there are no cameras to render") };
    let opened = Opened { scene: Scene::default(), content: Content::Model(renderer.clone()) };
    let worker = Worker::start(gpu.clone(), Nothing, Some(opened), egui::Context::default());
    let texture = crate::canvas::texture(&gpu, [width, height]);
    let sheet = Sheet { texture, mode: Mode::Final, style: Style::default() };
    let (mut alone, mut in_window) = (Vec::new(), Vec::new());
    for camera in cameras {
        let start = Instant::now();
        drop(renderer.render(camera)?);
        gpu.wait()?;
        alone.push(1e3 * start.elapsed().as_secs_f64());

        let start = Instant::now();
        let request = Request { camera: *camera, with_range: false, looks: Default::default(), background: None };
        worker.send(Command::Render(Box::new(request), Some(sheet.clone())));
        loop {
            match worker.messages.recv()? {
                Message::Rendered(_) => break,
                Message::Failed(sentence) => bail!(sentence),
                _ => {}
            }
        }
        gpu.wait()?;
        in_window.push(1e3 * start.elapsed().as_secs_f64());
    }
    let counted = |mut times: Vec<f64>| median(times.split_off(times.len() / 10));
    Ok(FrameTimes { alone: counted(alone), in_window: counted(in_window) })
}
