//! A device that goes away in the middle of a training.

use crate::small::{dataset, staged};
use ibgs_core::config::TrainConfig;
use ibgs_core::output::OutputFolder;
use ibgs_core::scene::read_ply;
use ibgs_reference::gpu::{gpu, open_gpu};
use ibgs_train::Session;
use ibgs_train::session::{Output, SessionError, StoppedTraining};

/// It ends with a sentence, and on another device goes on from its last state as if nothing had happened.
#[test]
fn a_training_whose_device_is_lost_is_resumed_bit_for_bit() {
    let work = tempfile::tempdir().unwrap();
    let [folder, other] = ["lost", "whole"].map(|name| OutputFolder::at(&work.path().join(name)));
    let config = TrainConfig { deterministic: true, ..staged(24) };
    let session = |folder: &OutputFolder| {
        Session::builder(config.clone()).dataset(dataset()).output(Output::at(folder.root())).checkpoint_every(None)
    };
    let own = open_gpu();
    let mut lost = session(&folder).build(&own, &mut ()).unwrap();
    while lost.progress().iteration < 20 {
        lost.step(&mut ()).unwrap();
    }
    own.device.destroy();
    let error = lost.run(&mut ()).unwrap_err();
    let SessionError::Stopped { source, saved: Some(saved), checkpoint: Some(checkpoint), .. } = &error else {
        panic!("{error}")
    };
    assert!(source.to_string().starts_with("the GPU has failed: the device is lost"), "{source}");
    assert!(saved.is_file() && folder.checkpoint_path(*checkpoint).is_file(), "{error}");
    // The state before the stage of the residual.
    assert_eq!(*checkpoint, 14);
    drop(lost);
    let stopped = StoppedTraining::open(folder.root(), &mut ()).unwrap();
    let resumed = Session::builder(folder.read_config().unwrap()).dataset(dataset()).resumed_from(stopped);
    resumed.build(&gpu(), &mut ()).unwrap().run(&mut ()).unwrap();
    session(&other).build(&gpu(), &mut ()).unwrap().run(&mut ()).unwrap();
    let model = |folder: &OutputFolder| read_ply(&folder.point_cloud_path(24)).unwrap();
    assert_eq!(model(&folder), model(&other));
    let network = |folder: &OutputFolder| std::fs::read(folder.network_path(24).unwrap()).unwrap();
    assert_eq!(network(&folder), network(&other));
}
