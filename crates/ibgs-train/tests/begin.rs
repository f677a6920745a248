//! Why a session cannot begin, as far as no GPU is needed, and which checkpoint it resumes from.

use ibgs_core::config::{Method, TrainConfig};
use ibgs_core::output::{Existing, OutputError, OutputFolder};
use ibgs_core::stored_zip;
use ibgs_testing::checkpoint_file;
use ibgs_train::Session;
use ibgs_train::checkpoint::{self, CheckpointError};
use ibgs_train::session::{BuildError, Event, Observer, Output, StoppedTraining};
use std::fs::{self, File};
use std::path::{Path, PathBuf};

/// Keeps what is reported.
#[derive(Default)]
struct Lines(Vec<String>);

impl Observer for Lines {
    fn event(&mut self, event: &Event) {
        self.0.push(event.to_string());
    }
}

fn options(seed: u64) -> TrainConfig {
    TrainConfig { method: Method::Gs3, iterations: Some(60), seed, ..TrainConfig::default() }
}

/// Writes a checkpoint of a run with this seed, by which a test knows it again.
fn write_checkpoint(folder: &Path, iteration: u32, seed: u64) -> PathBuf {
    let path = OutputFolder::at(folder).checkpoint_path(iteration);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    let parts = checkpoint_file::parts(checkpoint::FORMAT, checkpoint::VERSION, &options(seed).to_text().unwrap());
    let add = |(name, bytes): &(String, Vec<u8>), zip: &mut _| stored_zip::add(zip, name, bytes);
    stored_zip::write(File::create(&path).unwrap(), |zip| parts.iter().try_for_each(|part| add(part, zip))).unwrap();
    path
}

/// Writes what a saved model is recognised by.
fn write_model(folder: &Path, iteration: u32) {
    let path = OutputFolder::at(folder).point_cloud_path(iteration);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, "ply").unwrap();
}

fn refused(output: Output) -> BuildError {
    Session::builder(options(0)).output(output).load(&mut ()).expect_err("the folder is taken")
}

#[test]
fn a_folder_that_is_taken_is_refused_and_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let [trained, stopped, foreign, free] = ["trained", "stopped", "foreign", "free"].map(|n| folder.path().join(n));
    write_model(&trained, 7);
    write_checkpoint(&stopped, 8, 0);
    fs::create_dir(&foreign).unwrap();
    fs::write(foreign.join("cameras.json"), "[]").unwrap();
    assert!(matches!(
        refused(Output::at(&trained)),
        BuildError::Output(OutputError::HoldsModel { iteration: 7, path }) if path == trained
    ));
    assert!(matches!(
        refused(Output::at(&stopped)),
        BuildError::Output(OutputError::HoldsTraining { iteration: 8, .. })
    ));
    assert!(matches!(
        refused(Output::at(&foreign)),
        BuildError::Output(OutputError::Foreign { file: "cameras.json", .. })
    ));
    // What may be replaced is still there, and a new folder is not made yet.
    for output in [Output::at(&trained).existing(Existing::Replace), Output::at(&free)] {
        let loaded = Session::builder(options(0)).output(output).load(&mut ()).unwrap();
        assert!(!loaded.has_scene());
    }
    assert!(OutputFolder::open(&trained).is_ok() && !free.exists());
}

#[cfg(unix)]
#[test]
fn a_folder_that_is_trained_into_is_refused_even_to_be_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let lock = OutputFolder::at(folder.path()).lock().unwrap();
    let replacing = || Output::at(folder.path()).existing(Existing::Replace);
    assert!(matches!(refused(replacing()), BuildError::Output(OutputError::Busy { .. })));
    drop(lock);
    Session::builder(options(0)).output(replacing()).load(&mut ()).unwrap();
}

#[test]
fn a_scene_is_no_model_folder() {
    let folder = tempfile::tempdir().unwrap();
    let mut config = options(0);
    config.source = Some(folder.path().to_owned());
    let output = Output::at(folder.path().join(".")).existing(Existing::Replace);
    let error = Session::builder(config).output(output).load(&mut ()).unwrap_err();
    assert!(matches!(error, BuildError::IsScene { .. }), "{error}");
}

#[test]
fn options_are_checked_before_the_folder() {
    let folder = tempfile::tempdir().unwrap();
    write_model(folder.path(), 7);
    let config = TrainConfig { iterations: Some(0), ..options(0) };
    let error = Session::builder(config).output(Output::at(folder.path())).load(&mut ()).unwrap_err();
    assert!(matches!(error, BuildError::Config(_)), "{error}");
}

#[test]
fn a_scene_that_is_missing_is_told_after_it_was_said_to_be_loaded() {
    let mut config = options(0);
    config.source = Some("no/such/scene".into());
    let mut lines = Lines::default();
    let error = Session::builder(config).load(&mut lines).unwrap_err();
    assert!(matches!(error, BuildError::Scene(_)), "{error}");
    assert_eq!(lines.0, ["loading the photos"]);
}

#[test]
fn a_resumed_training_keeps_its_options_but_for_where_things_are() {
    let folder = tempfile::tempdir().unwrap();
    write_checkpoint(folder.path(), 3, 5);
    let stopped = || StoppedTraining::open(folder.path(), &mut ()).unwrap();
    let mut moved = options(5);
    moved.data.host_memory = "8GiB".parse().unwrap();
    moved.data.split = Some("elsewhere/split.json".into());
    let mut loaded = Session::builder(moved.clone()).resumed_from(stopped()).load(&mut ()).unwrap();
    loaded.adapt(|config| config.iterations = Some(1));
    assert_eq!(*loaded.config(), moved);

    for (config, name, values) in [
        (TrainConfig { iterations: Some(70), ..options(5) }, "iterations", ["60", "70"]),
        (options(6), "seed", ["5", "6"]),
        (TrainConfig { sh_degree: Some(1), ..options(5) }, "sh-degree", ["unset", "1"]),
    ] {
        let error = Session::builder(config).resumed_from(stopped()).load(&mut ()).unwrap_err();
        let BuildError::OtherOption { path, option } = &error else { panic!("{error}") };
        assert_eq!((&**path, &*option.name), (folder.path(), name));
        let [kept, given] = values;
        let said = error.to_string();
        assert!(said.contains(&format!("the option `{name}` at {kept}, not {given}; a resumed run")), "{said}");
    }
}

#[test]
fn a_folder_without_a_checkpoint_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let why = || StoppedTraining::open(folder.path(), &mut ()).unwrap_err();
    assert!(matches!(why(), BuildError::NoCheckpoint { path } if path == folder.path()));
    write_model(folder.path(), 20);
    // Nothing says that it was to become longer.
    assert!(matches!(why(), BuildError::Ended { iteration: 20, .. }));
    options(0).save(&OutputFolder::at(folder.path()).config_path()).unwrap();
    let BuildError::OnlyModel { iteration, iterations, gaussians, .. } = why() else { panic!("{}", why()) };
    assert_eq!((iteration, iterations), (20, 60));
    assert!(gaussians.is_file());
    write_model(folder.path(), 60);
    assert!(matches!(why(), BuildError::Ended { iteration: 60, .. }));
}

#[test]
fn a_damaged_checkpoint_is_told_and_the_one_before_helps() {
    let folder = tempfile::tempdir().unwrap();
    let paths = [(10, 1), (20, 2), (30, 3)].map(|(iteration, seed)| write_checkpoint(folder.path(), iteration, seed));
    let resumed = || {
        let mut lines = Lines::default();
        let seed = StoppedTraining::open(folder.path(), &mut lines).map(|stopped| stopped.checkpoint().config.seed);
        (seed, lines.0)
    };
    let (seed, lines) = resumed();
    assert_eq!((seed.unwrap(), lines.len()), (3, 0));
    for (at, left) in [(2, 2), (1, 1)] {
        let bytes = fs::read(&paths[at]).unwrap();
        fs::write(&paths[at], &bytes[..bytes.len() / 2]).unwrap();
        let (seed, lines) = resumed();
        assert_eq!((seed.unwrap(), lines.len()), (left, 3 - left as usize));
        let last = lines.last().unwrap();
        let file = paths[at].display();
        assert!(last.starts_with(&format!("warning: the checkpoint {file} is damaged: ")), "{last}");
        assert!(last.ends_with("; resuming from the one before"), "{last}");
    }
    fs::write(&paths[0], "PK").unwrap();
    let (seed, lines) = resumed();
    assert_eq!(lines.len(), 2);
    let is_oldest = |path: &Path| path == paths[0];
    assert!(matches!(
        seed.unwrap_err(),
        BuildError::Checkpoint(CheckpointError::Damaged { path, .. }) if is_oldest(&path)
    ));
}
