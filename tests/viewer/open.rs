//! The start page, what is dropped into the window, and what cannot be opened.

use super::*;
use eframe::egui::{DroppedFile, Theme};
use eframe::{APP_KEY, App};
use egui_kittest::kittest::Queryable;
use ibgs::commands::train::requested;
use ibgs_core::config::{ExposureConfig, ExposureSwitch, Method, Preset};
use ibgs_core::dataset::{Masks, Resolution};
use ibgs_core::raster::Rasterizer;
use ibgs_core::scene::{PlyFlavor, write_ply};
use ibgs_reference::gpu::open_gpu;
use ibgs_testing::scene_files::{Model, write_file};
use ibgs_train::session::Output;
use ibgs_viewer::{OpenRequest, TrainingRequest};
use std::collections::HashMap;
use std::path::PathBuf;

#[derive(Debug)]
struct Dropped(PathBuf);

impl DroppedFile for Dropped {
    fn path(&self) -> &Path {
        &self.0
    }

    fn bytes(&self) -> Result<Vec<u8>, String> {
        std::fs::read(&self.0).map_err(|error| error.to_string())
    }
}

pub(super) fn drop_into(window: &mut Window, path: &Path) {
    window.input_mut().dropped_files.push(Arc::new(Dropped(path.to_owned())));
    settle(window);
}

/// Types into the field of this name, in place of what it holds.
fn type_into(window: &mut Window, field: &str, text: &str) {
    window.get_by_label(field).focus();
    window.run_steps(2);
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.run_steps(2);
    window.event(Event::Text(text.to_owned()));
    window.run_steps(2);
}

fn pick(window: &mut Window, label: &str) {
    window.get_by_label(label).click();
    settle(window);
}

/// Opens as the program does; trainings are written into its folder.
struct Into(PathBuf);

impl Open for Into {
    fn demo_iterations(&self, gpu: &Gpu) -> u32 {
        Opener::default().demo_iterations(gpu)
    }

    fn sentence(&self, error: &anyhow::Error) -> String {
        Opener::default().sentence(error)
    }

    fn open(&self, wanted: &OpenRequest, gpu: &Arc<Gpu>, status: &Status<'_>) -> anyhow::Result<Outcome> {
        match wanted {
            OpenRequest::Train(request) if request.scene.as_ref().is_some_and(|scene| scene.exists()) => {
                let training = requested(request)?.output(Output::at(&self.0));
                Ok(Outcome::Opened(Box::new(Opener::default().train(training, gpu, status)?)))
            }
            other => Opener::default().open(other, gpu, status),
        }
    }
}

fn asking(model: &Path, first: Option<Outcome>) -> Window {
    window_with(&gpu(), Into(model.to_owned()), first, Vec2::new(1280.0, 800.0), None, 1.0)
}

/// What the program stores from one start to the next.
#[derive(Default)]
pub(super) struct Stored(pub HashMap<String, String>);

impl Storage for Stored {
    fn get_string(&self, key: &str) -> Option<String> {
        self.0.get(key).cloned()
    }

    fn set_string(&mut self, key: &str, value: String) {
        self.0.insert(key.to_owned(), value);
    }

    fn remove_string(&mut self, key: &str) {
        self.0.remove(key);
    }

    fn flush(&mut self) {}
}

/// The program started again with this in its storage.
fn restarted(stored: Stored, size: Vec2) -> Window {
    window_with(&gpu(), Opener::default(), None, size, Some(Box::leak(Box::new(stored))), 1.0)
}

#[test]
fn what_was_opened_before_survives_a_restart() {
    let folder = tempfile::tempdir().unwrap();
    let (renderer, _) = small_model();
    let gaussians = renderer.splats().download(renderer.gpu()).unwrap();
    let [kept, gone] = ["kept.ply", "gone.ply"].map(|name| folder.path().join(name));
    let mut window = window(None);
    for path in [&kept, &gone] {
        write_ply(path, &gaussians, PlyFlavor::Full).unwrap();
        drop_into(&mut window, path);
        assert_eq!(window.state().error(), None);
    }
    let mut stored = Stored::default();
    window.state_mut().save(&mut stored);
    drop(window);
    std::fs::remove_file(&gone).unwrap();
    let mut window = restarted(stored, Vec2::new(760.0, 640.0));
    window.get_by_label("Opened before");
    // What is not there any more cannot be opened.
    pick(&mut window, "gone.ply");
    assert!(window.state().scene().is_none() && window.state().error().is_none());
    pick(&mut window, "kept.ply");
    assert_eq!(window.state().scene().unwrap().path.as_ref(), Some(&kept));
    // Nor does a damaged list keep the program from starting.
    let damaged = Stored([(APP_KEY.to_owned(), "(recent: 7".to_owned())].into());
    assert!(restarted(damaged, Vec2::new(760.0, 640.0)).query_by_label("Opened before").is_none());
}

#[test]
fn the_start_page_looks_as_it_should() {
    start_page(Vec2::new(1280.0, 800.0), "");
}

#[test]
fn a_small_start_page_scrolls() {
    let mut window = start_page(Vec2::new(620.0, 420.0), " in a small window");
    window.get_by_label("Train").scroll_to_me();
    window.run_steps(20);
    pick(&mut window, "Train");
    window.run_steps(20);
    window.get_by_label_contains("choose a scene folder");
    snapshot(&mut window, "start page scrolled", 100);
}

/// Compares the page, with a model that has a picture, a file without one and a model that is not there any more.
fn start_page(size: Vec2, name: &str) -> Window {
    let folder = tempfile::tempdir().unwrap();
    let picture = include_bytes!("../../crates/ibgs-viewer/assets/demo.jpg");
    write_file(&folder.path().join("room/test/ours_30000/renders/a.jpg"), picture);
    write_file(&folder.path().join("garden.ply"), "no picture");
    let recent = ["room", "garden.ply", "a model with a long name that was moved"].map(|name| folder.path().join(name));
    let mut window = restarted(Stored([(APP_KEY.to_owned(), format!("(recent: {recent:?})"))].into()), size);
    for (theme, kind) in [(Theme::Dark, "dark"), (Theme::Light, "light")] {
        window.ctx.set_theme(theme);
        window.run_steps(3);
        snapshot(&mut window, &format!("start page {kind}{name}"), 100);
    }
    window
}

#[test]
fn a_scene_is_asked_about_and_trained_as_chosen() {
    let (scene, folder) = (Model::small(8).scene(), tempfile::tempdir().unwrap());
    let model = folder.path().join("model");
    let mut window = asking(&model, None);
    drop_into(&mut window, scene.path());
    assert!(window.state().scene().is_none() && window.state().error().is_none(), "{:?}", window.state().error());
    assert!(!model.exists(), "nothing begins before it is asked for");
    window.get_by_label("3DGS").click();
    window.get_by_label("off").click();
    type_into(&mut window, "Iterations", "many");
    pick(&mut window, "Train");
    window.get_by_label_contains("`many` is not a number of iterations");
    for (field, wrong, said) in
        [("Gaussians", "few", "no number of Gaussians"), ("Photo size", "-3", "no size of photos")]
    {
        type_into(&mut window, "Iterations", "12");
        type_into(&mut window, field, wrong);
        pick(&mut window, "Train");
        window.get_by_label_contains(said);
        type_into(&mut window, field, if field == "Gaussians" { "2k" } else { "2" });
    }
    window.get_by_label("every 8th photo").click();
    assert!(window.state().scene().is_none());
    type_into(&mut window, "Iterations", "12");
    pick(&mut window, "Train");
    until(&mut window, "begun", |viewer| viewer.progress().is_some());
    assert_eq!((window.state().progress().unwrap().0.iterations, window.state().error()), (12, None));
    drop(window);
    let config = TrainConfig::load(&model.join("config.toml")).unwrap();
    assert_eq!((config.iterations(), config.method, config.exposure.enabled), (12, Method::Gs3, ExposureSwitch::Off));
    assert_eq!(config.source.as_deref(), Some(scene.path()));
    assert_eq!(
        (config.densify.max_splats, config.data.resolution, config.data.eval),
        (Some(2_000), Resolution::Factor(2), true)
    );
}

#[test]
fn a_window_on_a_scene_begins_with_its_form() {
    let (scene, folder) = (Model::small(8).scene(), tempfile::tempdir().unwrap());
    let mut window = asking(&folder.path().join("model"), Some(Outcome::Scene(scene.path().to_owned())));
    assert!(window.state().scene().is_none());
    type_into(&mut window, "Iterations", "3");
    pick(&mut window, "Train");
    until(&mut window, "begun", |viewer| viewer.progress().is_some());
    let config = TrainConfig::load(&folder.path().join("model/config.toml")).unwrap();
    let usual = TrainConfig { iterations: Some(3), ..TrainConfig::default() };
    // Settled: so short a run makes no trial of exposures.
    let exposure = ExposureConfig { enabled: ExposureSwitch::Off, ..usual.exposure };
    assert_eq!((config.method, config.exposure), (usual.method, exposure));
    // Back to the page and to the training.
    pick(&mut window, "Scene");
    pick(&mut window, "Start page");
    window.get_by_label("Train on a scene");
    pick(&mut window, "Back");
    assert!(window.query_by_label("Train on a scene").is_none());
}

#[test]
fn a_scene_that_is_missing_is_an_error_in_the_page() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = asking(&folder.path().join("model"), None);
    pick(&mut window, "Train");
    window.get_by_label_contains("choose a scene folder");
    type_into(&mut window, "Scene folder", "no/such/scene");
    assert!(window.query_by_label_contains("choose a scene folder").is_none(), "it is said until it is mended");
    pick(&mut window, "Train");
    assert_eq!(window.state().error(), Some("no/such/scene does not exist; check the path"));
    window.get_by_label_contains("no/such/scene does not exist");
    assert!(window.state().scene().is_none());
}

#[test]
fn a_wish_becomes_the_options_of_a_training() {
    let usual = requested(&TrainingRequest::default()).unwrap();
    assert_eq!(*usual.config(), TrainConfig::default());
    let request = TrainingRequest {
        scene: Some("some/scene".into()),
        preset: Preset::Fast,
        method: Method::Gs3,
        iterations: Some(77),
        exposure: ExposureSwitch::On,
        eval: true,
        resolution: Resolution::Factor(2),
        max_splats: Some(5_000),
        masks: Some(Masks::Object),
        model: Some("some/model".into()),
    };
    let training = requested(&request).unwrap();
    let mut expected = TrainConfig { method: Method::Gs3, iterations: Some(77), ..TrainConfig::preset(Preset::Fast) };
    expected.exposure.enabled = ExposureSwitch::On;
    expected.source = Some(std::path::absolute("some/scene").unwrap());
    (expected.data.eval, expected.data.resolution, expected.data.masks) =
        (true, Resolution::Factor(2), Some(Masks::Object));
    expected.densify.max_splats = Some(5_000);
    assert_eq!(*training.config(), expected);
    assert!(requested(&TrainingRequest { scene: Some(PathBuf::new()), ..request }).is_err());
}

#[test]
fn the_start_page_opens_what_is_typed() {
    let folder = tempfile::tempdir().unwrap();
    let (renderer, _) = small_model();
    let file = folder.path().join("model.ply");
    write_ply(&file, &renderer.splats().download(renderer.gpu()).unwrap(), PlyFlavor::Full).unwrap();
    let mut window = window(None);
    assert!(window.state().scene().is_none());
    type_into(&mut window, "Path", &file.display().to_string());
    window.get_by_label("Open").click();
    settle(&mut window);
    assert_eq!(window.state().error(), None);
    let scene = window.state().scene().unwrap();
    assert!(scene.views.is_empty() && !scene.points.is_empty());
}

#[test]
fn what_cannot_be_opened_is_told_in_a_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = window(Some(small(folder.path())));
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    };
    let empty = folder.path().join("empty");
    std::fs::create_dir(&empty).unwrap();
    let cases = [
        (folder.path().join("missing"), "missing"),
        (write("notes.txt", b"hello"), "notes.txt"),
        (write("cut.ply", b"ply\nformat binary_little_endian 1.0\nelement vertex 9\n"), "cut.ply"),
        (write("noise.ibgs", &[7; 99]), "noise.ibgs"),
        (empty, "empty"),
    ];
    for (path, named) in cases {
        drop_into(&mut window, &path);
        let error = window.state().error().unwrap_or_else(|| panic!("{named} was opened")).to_owned();
        assert!(error.contains(named) && !error.contains('\n'), "{error}");
        assert_eq!(window.state().scene().unwrap().title, "small", "what was open stays open");
        window.get_by_label("Close").click();
        window.run_steps(2);
        assert_eq!(window.state().error(), None);
    }
    window.state_mut().open(OpenRequest::Path(folder.path().join("notes.txt")));
    settle(&mut window);
    window.run_steps(5);
    window.state_mut().show_figures(false);
    window.run_steps(20);
    assert!(window.state().error().is_some());
}

/// A device that goes away while a model is shown: a sentence in place of a crash.
#[test]
fn a_lost_device_is_told() {
    let folder = tempfile::tempdir().unwrap();
    // One of its own: the other tests need theirs.
    let own = open_gpu();
    let dataset = many_points();
    let splats = Splats::upload(&from_points(&dataset.points, 0, 0.6).unwrap(), &own).unwrap();
    let renderer = Renderer::new(Arc::new(Rasterizer::new(own.clone())), splats, [0.0; 3], None).showing_surface();
    let content = Content::Model(Arc::new(renderer));
    let opened = Opened { scene: surroundings(dataset, folder.path()), content };
    let mut window = window_on(&own, Some(opened), Vec2::new(500.0, 320.0));
    assert_eq!(window.state().error(), None);
    own.device.destroy();
    window.key_press(Key::ArrowRight);
    until(&mut window, "told", |viewer| viewer.error().is_some());
    let error = window.state().error().unwrap();
    assert!(error.contains("the GPU has failed") && error.ends_with("has to be started again"), "{error}");
}
