//! Training in the window.

use super::*;
use crate::small::{dataset, staged};
use egui_kittest::kittest::Queryable;
use ibgs::commands::train::{Failure, Watched};
use ibgs_core::config::ExposureSwitch;
use ibgs_core::dataset::InitialPoints;
use ibgs_core::gpu::{AdapterChoice, Use};
use ibgs_core::output::OutputFolder;
use ibgs_core::sources::memory::MemoryBudget;
use ibgs_train::Session;
use ibgs_train::session::Output;

fn training(gpu: &Arc<Gpu>, folder: &Path, iterations: u32) -> Opened {
    training_with(gpu, folder, iterations, &Failure::default())
}

/// A training that keeps its errors.
fn training_with(gpu: &Arc<Gpu>, folder: &Path, iterations: u32, failure: &Failure) -> Opened {
    let (dataset, mut config) = (dataset(), staged(iterations));
    config.residual.factor = Some(0.25);
    // The same on every adapter.
    config.data.initial_points = InitialPoints::Scene;
    config.exposure.enabled = ExposureSwitch::On;
    let scene = surroundings(&dataset, folder);
    let session = Session::builder(config).dataset(dataset).output(Output::at(folder.join("model")));
    let session = session.gpu_memory(MemoryBudget::Unlimited).checkpoint_every(None).build(gpu, &mut ()).unwrap();
    Opened { scene, content: Content::Training(Box::new(Watched::new(session, failure))) }
}

fn iteration(viewer: &Viewer) -> u32 {
    viewer.progress().unwrap().0.iteration
}

#[test]
fn a_training_can_be_watched_paused_stepped_and_saved() {
    let folder = tempfile::tempdir().unwrap();
    let size = Vec2::new(1000.0, 640.0);
    let mut window = window_on(&gpu(), Some(training(&gpu(), folder.path(), 50)), size);
    until(&mut window, "on its way", |viewer| iteration(viewer) >= 5);
    window.get_by_label("Pause").click();
    until(&mut window, "paused", |viewer| !viewer.progress().unwrap().1);
    settle(&mut window);
    let paused = iteration(window.state());
    assert!(paused < 50);
    window.run_steps(20);
    assert_eq!(iteration(window.state()), paused);
    window.get_by_label("Step").click();
    until(&mut window, "a step further", |viewer| iteration(viewer) == paused + 1);
    window.get_by_label("Save").click();
    until(&mut window, "saved", |viewer| viewer.message().is_some());
    let saved = folder.path().join(format!("model/point_cloud/iteration_{}/point_cloud.ply", paused + 1));
    assert!(saved.is_file(), "{:?}", window.state().message());
    window.get_by_label("Go on").click();
    until(&mut window, "trained", |viewer| iteration(viewer) == 50 && !viewer.progress().unwrap().1);
    let (progress, _) = window.state().progress().unwrap();
    let measured = progress.evaluations.last().unwrap();
    assert_eq!((measured.iteration, progress.iterations), (50, 50));
    assert!(progress.loss.is_some() && measured.image.is_some(), "{progress:?}");
    settle(&mut window);
    window.state_mut().show_figures(false);
    window.run_steps(30);
    // The message names a temporary folder, and the time is never the same; the photo, as what fifty iterations make
    // of it moves with every change of the training.
    if let Some(close) = window.query_by_label("Close") {
        close.click();
    }
    window.get_by_label("More").click();
    window.run_steps(3);
    window.get_by_label("Photo").click();
    settle(&mut window);
    snapshot(&mut window, "training", 4000);
    assert!(window.state().offers(ibgs_viewer::Mode::Residual), "the network is there");
    assert!(folder.path().join("model/point_cloud/iteration_50/point_cloud.ply").is_file());
    assert_eq!(window.state().error(), None);
}

#[test]
fn a_training_can_be_stopped_and_its_model_opened() {
    let folder = tempfile::tempdir().unwrap();
    let mut opened = training(&gpu(), folder.path(), 10_000);
    let model = folder.path().join("model");
    opened.scene.path = Some(model.clone());
    let mut window = window_on(&gpu(), Some(opened), Vec2::new(1000.0, 640.0));
    until(&mut window, "on its way", |viewer| iteration(viewer) >= 3);
    assert!(window.query_by_label("Open the model").is_none());
    window.get_by_label("Stop").click();
    until(&mut window, "stopped", |viewer| viewer.progress().is_some_and(|(_, running)| !running));
    while window.query_by_label("Open the model").is_none() {
        window.step();
    }
    assert_eq!(window.state().error(), None);
    let output = OutputFolder::open(&model).unwrap();
    assert_eq!(output.latest_iteration().unwrap(), Some(iteration(window.state())));
    window.get_by_label_contains("--resume");
    window.get_by_label("Open the model").click();
    until(&mut window, "opened", |viewer| viewer.progress().is_none());
    settle(&mut window);
    assert_eq!(window.state().error(), None);
}

/// Closing the window ends the training as Ctrl-C does: saved and measured.
#[test]
fn a_closed_window_leaves_a_saved_model() {
    let folder = tempfile::tempdir().unwrap();
    let failure = Failure::default();
    let mut window = window(Some(training_with(&gpu(), folder.path(), 10_000, &failure)));
    until(&mut window, "on its way", |viewer| iteration(viewer) >= 3);
    drop(window);
    failure.outcome().unwrap();
    let output = OutputFolder::open(&folder.path().join("model")).unwrap();
    let latest = output.latest_iteration().unwrap().unwrap();
    assert!((3..10_000).contains(&latest), "{latest}");
}

#[test]
fn a_wait_for_work_that_a_lost_device_did_not_take_names_the_loss() {
    let own = Gpu::open(&AdapterChoice::Best, Use::Training).unwrap();
    own.device.destroy();
    let error = own.wait_for(own.mark()).unwrap_err().to_string();
    assert!(error.contains("the GPU has failed: the device is lost"), "{error}");
}

/// A device that goes away: a sentence in place of a crash, and the model of before on disk.
#[test]
fn a_lost_device_is_survived() {
    let folder = tempfile::tempdir().unwrap();
    // One of its own: the other tests need theirs.
    let own = Gpu::open(&AdapterChoice::Best, Use::Training).unwrap();
    let failure = Failure::default();
    let opened = training_with(&own, folder.path(), 10_000, &failure);
    let mut window = window_on(&own, Some(opened), Vec2::new(500.0, 320.0));
    until(&mut window, "on its way", |viewer| iteration(viewer) >= 3);
    own.device.destroy();
    until(&mut window, "told", |viewer| viewer.error().is_some_and(|error| error.contains("the model so far is in")));
    let error = window.state().error().unwrap().to_owned();
    assert!(!error.contains('\n') && error.contains("the GPU has failed"), "{error}");
    // The program ends with it.
    drop(window);
    assert_eq!(failure.outcome().unwrap_err().to_string(), error);
    failure.outcome().expect("once");
    let output = OutputFolder::open(&folder.path().join("model")).unwrap();
    assert!(output.latest_iteration().unwrap().is_some(), "{error}");
}

/// A folder that goes away while the window is open: what cannot be saved when it is closed ends the program as an error.
#[test]
fn what_fails_after_the_window_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let failure = Failure::default();
    let mut window = window(Some(training_with(&gpu(), folder.path(), 10_000, &failure)));
    until(&mut window, "on its way", |viewer| iteration(viewer) >= 3);
    window.get_by_label("Pause").click();
    until(&mut window, "paused", |viewer| !viewer.progress().unwrap().1);
    let model = folder.path().join("model");
    std::fs::remove_dir_all(&model).unwrap();
    std::fs::write(&model, "a file").unwrap();
    drop(window);
    let error = failure.outcome().unwrap_err().to_string();
    assert!(error.contains("choose another path"), "{error}");
}
