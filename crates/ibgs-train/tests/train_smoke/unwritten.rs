//! Files that cannot be written in the middle of a training, and at its end.

use super::dataset;
use crate::small::{plain, staged};
use ibgs_core::config::TrainConfig;
use ibgs_core::output::OutputFolder;
use ibgs_reference::gpu::gpu;
use ibgs_train::Session;
use ibgs_train::session::{Event, Observer, Output, SessionError};
use std::fs;
use std::path::Path;
use std::time::Duration;

/// Keeps the warnings.
#[derive(Default)]
struct Warnings(Vec<String>);

impl Observer for Warnings {
    fn event(&mut self, event: &Event) {
        let text = event.to_string();
        self.0.extend(text.starts_with("warning: ").then_some(text));
    }
}

/// A training that is saved and measured after iterations 3, 6 and its last one, 9.
fn session(folder: &Path, config: TrainConfig, checkpoint_every: Option<Duration>) -> Session {
    let mut config = TrainConfig { save_iterations: Some(vec![3, 6]), eval_iterations: Some(vec![3, 6]), ..config };
    config.data.eval = true;
    let builder = Session::builder(config).dataset(dataset()).output(Output::at(folder));
    builder.checkpoint_every(checkpoint_every).build(&gpu(), &mut ()).unwrap()
}

fn step_to(session: &mut Session, iteration: u32, observer: &mut dyn Observer) {
    while session.progress().iteration < iteration {
        session.step(observer).unwrap();
    }
}

/// A file stands where a folder is to be.
#[test]
fn a_save_that_fails_on_the_way_is_a_warning_and_the_next_one_is_tried() {
    let work = tempfile::tempdir().unwrap();
    let folder = OutputFolder::at(&work.path().join("model"));
    let mut session = session(folder.root(), plain(9), None);
    let mut warnings = Warnings::default();
    let (clouds, pictures) = (folder.root().join("point_cloud"), folder.root().join("test"));
    [&clouds, &pictures].iter().for_each(|path| fs::write(path, "in the way").unwrap());
    step_to(&mut session, 4, &mut warnings);
    let [saving, measuring] = &warnings.0[..] else { panic!("{:?}", warnings.0) };
    assert!(saving.contains("point_cloud/iteration_3/point_cloud.ply") && saving.contains("choose another path"));
    assert!(
        measuring.contains("test/ours_3") && measuring.ends_with("; the training continues, and saves again later")
    );
    [&clouds, &pictures].iter().for_each(|path| fs::remove_file(path).unwrap());
    session.run(&mut warnings).unwrap();
    assert_eq!(warnings.0.len(), 2, "{:?}", warnings.0);
    assert_eq!(folder.iterations().unwrap(), [6, 9]);
    let measured: Vec<u32> = session.progress().evaluations.iter().map(|one| one.iteration).collect();
    assert_eq!(measured, [6, 9]);
}

#[test]
fn the_last_save_must_not_fail() {
    let work = tempfile::tempdir().unwrap();
    let folder = OutputFolder::at(&work.path().join("model"));
    let clouds = folder.root().join("point_cloud");
    let mut whole = session(folder.root(), plain(9), None);
    step_to(&mut whole, 7, &mut ());
    fs::rename(&clouds, work.path().join("saved")).unwrap();
    fs::write(&clouds, "in the way").unwrap();
    // What was trained is kept all the same.
    let Err(SessionError::Stopped { saved: None, checkpoint: Some(9), folder: at, .. }) = whole.run(&mut ()) else {
        panic!("a training that cannot save its model has not ended well");
    };
    assert_eq!(at, folder.root());
    assert!(folder.checkpoint_path(9).is_file());
    // Stopped before its end: also this save is the last one.
    let other = OutputFolder::at(&work.path().join("other"));
    let mut stopped = session(other.root(), plain(9), None);
    step_to(&mut stopped, 5, &mut ());
    fs::remove_dir_all(other.root().join("point_cloud")).unwrap();
    fs::write(other.root().join("point_cloud"), "in the way").unwrap();
    let error = stopped.finish(&mut ()).unwrap_err();
    let SessionError::OnlyCheckpoint { iteration: 5, folder: at, .. } = &error else { panic!("{error}") };
    assert_eq!(at, other.root());
    assert!(other.checkpoint_path(5).is_file());
}

#[test]
fn a_checkpoint_that_fails_is_a_warning_and_the_next_one_is_tried() {
    let work = tempfile::tempdir().unwrap();
    let folder = OutputFolder::at(&work.path().join("model"));
    // One after each iteration.
    let mut session = session(folder.root(), staged(9), Some(Duration::ZERO));
    let mut warnings = Warnings::default();
    let checkpoints = folder.root().join("checkpoints");
    fs::write(&checkpoints, "in the way").unwrap();
    step_to(&mut session, 4, &mut warnings);
    let failed = warnings.0.len();
    assert!(failed >= 2, "each is tried: {:?}", warnings.0);
    let is_checkpoint = |text: &String| text.contains("checkpoints") && text.ends_with("without this checkpoint");
    assert!(warnings.0.iter().all(is_checkpoint), "{:?}", warnings.0);
    fs::remove_file(&checkpoints).unwrap();
    step_to(&mut session, 8, &mut warnings);
    assert!(folder.checkpoint_path(7).is_file(), "{:?}", folder.checkpoints());
    // The one that was under way when the file went may have failed too.
    assert!(warnings.0.len() <= failed + 1, "{:?}", warnings.0);
    session.run(&mut warnings).unwrap();
    assert!(!checkpoints.exists() && folder.iterations().unwrap() == [3, 6, 9]);
}
