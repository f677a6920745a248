//! The viewer, driven without a window.

mod edit;
mod edit_ensemble;
mod edit_place;
mod edit_removed;
mod edit_tools;
mod leave;
mod look;
mod open;
mod path;
mod photos;
mod pixel;
mod settings;
mod share;
mod sides;
mod train;

use crate::small::{image_part, small_model};
use eframe::Storage;
use eframe::egui::{Event, Key, Modifiers, PointerButton, Pos2, Vec2};
use egui_kittest::wgpu::WgpuTestRenderer;
use egui_kittest::{Harness, SnapshotOptions};
use ibgs::commands::view::Opener;
use ibgs_core::config::TrainConfig;
use ibgs_core::dataset::Dataset;
use ibgs_core::gpu::Gpu;
use ibgs_core::render::{ImageOptions, ImagePart, Renderer};
use ibgs_core::residual::{Aggregation, Factor, Variant, weights};
use ibgs_core::scene::{Splats, from_points};
use ibgs_demo::DemoOptions;
use ibgs_reference::gpu::{gpu, rasterizer};
use ibgs_testing::tiny_demo;
use ibgs_viewer::{Content, Open, Opened, Outcome, Scene, Status, View, Viewer, wgpu_setup};
use std::path::Path;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

type Window = Harness<'static, Viewer>;

/// What stands around a model of a dataset.
fn surroundings(dataset: &Dataset, pictures: &Path) -> Scene {
    let views = View::all(dataset);
    let (title, points) = ("small".to_owned(), dataset.points.clone());
    Scene { title, views, points, pictures: pictures.to_owned(), path: None, model: None, note: None }
}

/// A model that was trained for a moment.
fn small(pictures: &Path) -> Opened {
    let (renderer, dataset) = small_model();
    let part = renderer.part().cloned();
    opened(&dataset, renderer.splats().clone(), part.unwrap(), pictures)
}

fn opened(dataset: &Dataset, splats: Splats, part: ImagePart, pictures: &Path) -> Opened {
    // The window's images are large for a software adapter.
    let variant = Variant { factor: Factor::Quarter, ..part.options.variant };
    let part = ImagePart { options: ImageOptions { variant, ..part.options }, ..part };
    let renderer = Renderer::new(Arc::new(rasterizer()), splats, [0.0; 3], Some(part)).showing_surface();
    Opened { scene: surroundings(dataset, pictures), content: Content::Model(Arc::new(renderer)) }
}

/// A model that every adapter has alike: Gaussians straight from the scene's points, and a network that has learnt nothing.
fn untrained(pictures: &Path) -> Opened {
    let dataset = many_points();
    let gaussians = from_points(&dataset.points, 0, 0.6).unwrap();
    let splats = Splats::upload(&gaussians, &gpu()).unwrap();
    let part = image_part(dataset, &mean_of_sources(), &weights::random(0));
    opened(dataset, splats, part, pictures)
}

/// The same without a network: its images take half of the time.
fn plain(pictures: &Path) -> Opened {
    let dataset = many_points();
    let splats = Splats::upload(&from_points(&dataset.points, 0, 0.6).unwrap(), &gpu()).unwrap();
    let renderer = Renderer::new(Arc::new(rasterizer()), splats, [0.0; 3], None).showing_surface();
    let content = Content::Model(Arc::new(renderer));
    Opened { scene: surroundings(dataset, pictures), content }
}

/// Options of the published network, which the snapshots show.
fn mean_of_sources() -> TrainConfig {
    let mut config = TrainConfig::default();
    config.residual.aggregation = Aggregation::Mean;
    config.residual.source_share = 0.0;
    config
}

/// Its scene.
fn many_points() -> &'static Dataset {
    static DATASET: OnceLock<Dataset> = OnceLock::new();
    let trace = || {
        let cache = tempfile::tempdir().unwrap();
        let options = DemoOptions { width: 48, height: 36, views: 24, points: 4_000, ..tiny_demo() };
        ibgs_demo::load(&options, Some(cache.path()), &()).unwrap()
    };
    DATASET.get_or_init(trace)
}

/// A window on what is opened; without anything, on the start page.
fn window_on(gpu: &Arc<Gpu>, opened: Option<Opened>, size: Vec2) -> Window {
    let first = opened.map(|opened| Outcome::Opened(Box::new(opened)));
    window_with(gpu, Opener::default(), first, size, None, 1.0)
}

/// A window whose requests go to this opener, and which remembers what is stored. Less than a pixel for a point spares a
/// software adapter three quarters of the picture.
fn window_with(
    gpu: &Arc<Gpu>,
    opener: impl Open,
    first: Option<Outcome>,
    size: Vec2,
    stored: Option<&'static dyn Storage>,
    pixels_per_point: f32,
) -> Window {
    let renderer = WgpuTestRenderer::from_setup(wgpu_setup(gpu));
    let builder = Harness::builder().with_size(size).with_step_dt(1.0 / 60.0).renderer(renderer);
    let builder = builder.with_pixels_per_point(pixels_per_point);
    let gpu = gpu.clone();
    let mut window = builder.build_eframe(move |cc| {
        cc.storage = stored;
        Viewer::new(cc, gpu, opener, first).unwrap()
    });
    settle(&mut window);
    // Pictures are compared, so their size must not depend on the machine's speed.
    window.state_mut().show_always_sharp(true);
    // What lies around a photo is time of a software adapter.
    window.state_mut().show_only_frame(true);
    settle(&mut window);
    window
}

fn window(opened: Option<Opened>) -> Window {
    window_on(&gpu(), opened, Vec2::new(760.0, 420.0))
}

/// The same with half a pixel for a point, where no picture is kept.
fn coarse(opened: Opened) -> Window {
    let first = Some(Outcome::Opened(Box::new(opened)));
    window_with(&gpu(), Opener::default(), first, Vec2::new(760.0, 420.0), None, 0.5)
}

/// Runs the window until something is so.
fn until(window: &mut Window, what: &str, mut is_so: impl FnMut(&Viewer) -> bool) {
    let start = Instant::now();
    loop {
        window.step();
        if is_so(window.state()) {
            return;
        }
        let state = window.state();
        assert!(start.elapsed() < Duration::from_secs(120), "not {what}; error: {:?}", state.error());
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Runs the window until its image is finished.
fn settle(window: &mut Window) {
    window.run_steps(3);
    until(window, "settled", Viewer::is_settled);
    window.run_steps(2);
}

fn press(window: &mut Window, key: Key) {
    window.key_press(key);
    settle(window);
}

fn button(window: &mut Window, at: Pos2, button: PointerButton, pressed: bool) {
    window.event(Event::PointerMoved(at));
    window.event(Event::PointerButton { pos: at, button, pressed, modifiers: Modifiers::NONE });
    window.step();
}

fn click(window: &mut Window, at: Pos2) {
    button(window, at, PointerButton::Primary, true);
    button(window, at, PointerButton::Primary, false);
}

fn drag(window: &mut Window, with: PointerButton, from: Pos2, by: Vec2) {
    button(window, from, with, true);
    for step in 1..6 {
        window.event(Event::PointerMoved(from + by * (step as f32 / 5.0)));
        window.step();
    }
    button(window, from + by, with, false);
    settle(window);
}

/// A part of the window, RGBA; its corners are shares of the window's size.
fn part(window: &mut Window, from: Vec2, to: Vec2) -> Vec<[u8; 4]> {
    let image = window.render().unwrap();
    let size = Vec2::new(image.width() as f32, image.height() as f32);
    let (from, to) = (from * size, to * size);
    let rows = from.y as u32..to.y as u32;
    rows.flat_map(|y| (from.x as u32..to.x as u32).map(move |x| (x, y))).map(|(x, y)| image.get_pixel(x, y).0).collect()
}

/// Compares the window with the picture of it that is kept; `changing` pixels may differ, as those of times do.
fn snapshot(window: &mut Window, name: &str, changing: usize) {
    let options =
        SnapshotOptions::new().output_path("tests/viewer/snapshots").threshold(2.0).max_failed_pixels(changing);
    window.snapshot_options(name, &options);
}

/// The canvas between the views at the left and whatever stands at the right.
const CANVAS: Pos2 = Pos2::new(460.0, 230.0);
