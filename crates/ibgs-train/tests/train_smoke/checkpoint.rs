//! Checkpoints: a training goes on from one as if nothing had happened.

use super::poses::training_cameras;
use super::units::moved;
use super::{densifying, poison};
use crate::small::{dataset, model, staged};
use crate::small::{run, trainer};
use ibgs_core::config::{AdamMoments, ExposureSwitch, Method, PoseSwitch, Strategy, TrainConfig};
use ibgs_core::dataset::{Dataset, Photo};
use ibgs_reference::gpu::rasterizer;
use ibgs_testing::TINY;
use ibgs_train::checkpoint::{Checkpoint, CheckpointError};
use ibgs_train::{TrainError, Trainer};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;
use std::sync::Arc;

/// All that a run has: surface, residual, burn-in, exposure, densification, a round after each 10 iterations.
fn everything(iterations: u32) -> TrainConfig {
    let mut config = TrainConfig { method: Method::Ibgs, deterministic: true, ..densifying(iterations, 45) };
    let stages = staged(iterations);
    (config.surface, config.residual) = (stages.surface, stages.residual);
    config.opacity_reset.interval = Some(20);
    config.exposure.enabled = ExposureSwitch::On;
    config.exposure.from = Some(5);
    config.poses.refine = PoseSwitch::On;
    config.poses.from = Some(3);
    config.densify.grad_threshold = 1e-5;
    config
}

fn resumed(dataset: &Dataset, checkpoint: &Checkpoint) -> Trainer {
    Trainer::resume(Arc::new(rasterizer()), dataset, checkpoint).unwrap()
}

#[test]
fn a_resumed_training_is_the_uninterrupted_one_bit_for_bit() {
    let dataset = dataset();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoints/1.ibgs");
    let plain = TrainConfig { method: Method::Gs3, ..everything(40) };
    let mut mcmc = plain.clone();
    mcmc.adam.moments = AdamMoments::Full;
    mcmc.densify.strategy = Strategy::Mcmc;
    mcmc.densify.max_splats = Some(400);
    mcmc.densify.end = Some(38);
    let mut fading = plain.clone();
    fading.densify.strategy = Strategy::Default;
    fading.densify.growth.threshold = 1e-6;
    for config in [everything(40), plain, mcmc, fading] {
        let mut whole = trainer(&dataset, &config);
        run(&mut whole, 40);
        let expected = model(&whole);
        assert_ne!(**whole.scene_cameras(), *training_cameras(&dataset), "the cameras must learn");
        let mut training = trainer(&dataset, &config);
        let first = training.splats().len();
        // In every stage, right before and after rounds and readbacks, some after having been resumed before.
        for at in [1, 12, 20, 24, 33] {
            run(&mut training, at);
            training.checkpoint(json!({"at": at})).unwrap().write(&path).unwrap();
            // Taking a checkpoint changes nothing: the run that took it may go on as well.
            if at != 20 {
                let checkpoint = Checkpoint::read(&path).unwrap();
                assert_eq!((checkpoint.iteration(), &checkpoint.run), (at, &json!({"at": at})));
                training = resumed(&dataset, &checkpoint);
            }
        }
        run(&mut training, 40);
        assert!(first < expected.0.len(), "the run must densify");
        assert!(model(&training) == expected, "{:?}: another model", config.densify.strategy);
        assert_eq!(training.scene_cameras(), whole.scene_cameras(), "{:?}", config.densify.strategy);
    }
}

/// Without `deterministic` the depth maps are rendered again.
#[test]
fn a_checkpoint_without_depth_maps_is_small_and_goes_on() {
    let dataset = dataset();
    let mut sizes = Vec::new();
    for deterministic in [true, false] {
        let config = TrainConfig { deterministic, ..everything(60) };
        let mut training = trainer(&dataset, &config);
        run(&mut training, 30);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("30.ibgs");
        training.checkpoint(Value::Null).unwrap().write(&path).unwrap();
        sizes.push(fs::metadata(&path).unwrap().len());
        let mut training = resumed(&dataset, &Checkpoint::read(&path).unwrap());
        run(&mut training, 33);
        model(&training);
    }
    assert!(sizes[1] + 28 * u64::from(TINY[0] * TINY[1]) * 4 <= sizes[0], "{sizes:?}");
}

#[test]
fn another_scene_is_refused() {
    let dataset = dataset();
    let mut training = trainer(&dataset, &everything(5));
    run(&mut training, 1);
    let checkpoint = training.checkpoint(Value::Null).unwrap();
    let refused = |dataset: &Dataset| {
        let error = Trainer::resume(Arc::new(rasterizer()), dataset, &checkpoint).err().unwrap();
        assert!(matches!(error, TrainError::Checkpoint(CheckpointError::OtherScene)), "{error}");
    };
    let mut other = dataset.clone();
    let mut photo = Photo::clone(&other.views[3].photo.pixels().unwrap());
    photo.rgba[0] ^= 1;
    other.views[3].photo = photo.into();
    refused(&other);
    refused(&moved(&dataset, 1.0, glam::DVec3::X));
    refused(&moved(&dataset, 2.0, glam::DVec3::ZERO));
    let mut other = dataset.clone();
    other.views[3].camera.focal.x += 1e-9;
    refused(&other);
    let mut other = dataset.clone();
    let moved = other.train.pop().unwrap();
    other.test.push(moved);
    refused(&other);
    let mut other = dataset.clone();
    other.views[3].name += "x";
    refused(&other);
}

/// Changes a part of a checkpoint and writes the archive again, sums and all.
fn with_part(
    path: &Path,
    part: &str,
    change: impl Fn(Vec<u8>) -> Option<Vec<u8>>,
) -> Result<Checkpoint, CheckpointError> {
    use std::io::{Read, Write};
    use zip::write::SimpleFileOptions;
    let mut old = zip::ZipArchive::new(fs::File::open(path).unwrap()).unwrap();
    let changed = path.with_extension("changed");
    let mut new = zip::ZipWriter::new(fs::File::create(&changed).unwrap());
    let stored = SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    for index in 0..old.len() {
        let mut entry = old.by_index(index).unwrap();
        let name = entry.name().unwrap().into_owned();
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).unwrap();
        let bytes = if name == part { change(bytes) } else { Some(bytes) };
        if let Some(bytes) = bytes {
            new.start_file(name, stored).unwrap();
            new.write_all(&bytes).unwrap();
        }
    }
    new.finish().unwrap();
    Checkpoint::read(&changed)
}

#[test]
fn damage_is_told() {
    let dataset = dataset();
    let mut training = trainer(&dataset, &everything(30));
    run(&mut training, 16);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("16.ibgs");
    training.checkpoint(Value::Null).unwrap().write(&path).unwrap();
    let good = fs::read(&path).unwrap();
    let bad = folder.path().join("bad.ibgs");
    let damaged = |bytes: &[u8], what: &str| {
        fs::write(&bad, bytes).unwrap();
        let error = Checkpoint::read(&bad).expect_err(what);
        assert!(matches!(error, CheckpointError::Damaged { .. }), "{what}: {error}");
        assert!(error.to_string().contains("bad.ibgs is damaged: "), "{error}");
    };
    for kept in [0, 1, 30, good.len() / 2, good.len() - 1] {
        damaged(&good[..kept], &format!("cut at {kept}"));
    }
    // A bit in the middle of each part; what lies between parts is not read.
    let mut zip = zip::ZipArchive::new(std::io::Cursor::new(&good)).unwrap();
    assert!(zip.len() > 40, "{} parts", zip.len());
    for index in 0..zip.len() {
        let entry = zip.by_index(index).unwrap();
        let (name, start, size) = (entry.name().unwrap().into_owned(), entry.data_start().unwrap(), entry.size());
        drop(entry);
        if size > 0 {
            let mut bytes = good.clone();
            bytes[(start + size / 2) as usize] ^= 4;
            damaged(&bytes, &name);
        }
    }
    // Parts that are whole and wrong.
    let wrong = |part: &str, change: &dyn Fn(Vec<u8>) -> Option<Vec<u8>>, words: &str| {
        let error = with_part(&path, part, change).expect_err(part).to_string();
        assert!(error.contains(words), "{part}: {error}");
    };
    wrong("state.json", &|_| None, "its `state.json` is missing");
    wrong("tensors/network.first", &|_| None, "its `tensors/network.first` is missing");
    wrong("tensors/means", &|bytes| Some(bytes[4..].to_vec()), "bytes in place of");
    wrong("state.json", &|_| Some(b"{}".to_vec()), "its `state.json` makes no sense");
    let text = |from: &'static str, to: &'static str| {
        move |bytes: Vec<u8>| {
            let text = String::from_utf8(bytes).unwrap();
            assert!(text.contains(from), "{text}");
            Some(text.replacen(from, to, 1).into_bytes())
        }
    };
    wrong("state.json", &text("\"gaussians\":", "\"gaussians\":1152921504606846976,\"x\":"), "makes no sense");
    wrong("config.toml", &text("iterations = 30", "iterations = 0"), "iterations");
    let version = concat!("\"", env!("CARGO_PKG_VERSION"), "\"");
    wrong("checkpoint.json", &text(version, "\"9.9.9\""), "is of ibgs 9.9.9");
    wrong("checkpoint.json", &text("\"format\":", "\"format\":9"), "(format 9");

    // Whole parts that do not fit the scene or each other are refused when the training is to go on.
    let nonsense = |part: &str, change: &dyn Fn(Vec<u8>) -> Option<Vec<u8>>, words: &str| {
        let checkpoint = with_part(&path, part, change).unwrap();
        let error = Trainer::resume(Arc::new(rasterizer()), &dataset, &checkpoint).err().expect(part).to_string();
        assert!(error.contains(words), "{part}: {error}");
    };
    let nan = |mut bytes: Vec<u8>| {
        bytes[..4].copy_from_slice(&f32::NAN.to_le_bytes());
        Some(bytes)
    };
    nonsense("tensors/means", &nan, "a number is not finite");
    nonsense("tensors/network.second", &nan, "a number is not finite");
    nonsense("state.json", &text("\"queue\":[", "\"queue\":[999,"), "names one that is not there");
    nonsense("state.json", &text("\"written\":16", "\"written\":99"), "its telemetry");
    nonsense("state.json", &text("\"steps\":[16", "\"steps\":[17"), "more steps than iterations");
    nonsense("state.json", &text("\"iteration\":16", "\"iteration\":31"), "beyond the last one");
}

/// What is no number is found within 100 iterations, wherever it is, and never gets into a checkpoint.
#[test]
fn what_is_no_number_is_found() {
    let dataset = dataset();
    let mut config = TrainConfig { method: Method::Ibgs, deterministic: true, ..staged(90) };
    config.residual.factor = Some(0.25);
    let mut sound = trainer(&dataset, &config);
    run(&mut sound, 40);
    let good = sound.checkpoint(Value::Null).unwrap();
    run(&mut sound, 50);
    for part in ["rotations", "normals", "network"] {
        let mut training = resumed(&dataset, &good);
        let splats = training.splats();
        match part {
            "rotations" => poison(&splats.parameters.rotations),
            "normals" => poison(&splats.parameters.normals),
            _ => poison(&training.renderer().unwrap().part().unwrap().network.weights),
        }
        let error = training.checkpoint(Value::Null).err().unwrap();
        assert!(matches!(error, TrainError::NotFinite(40)), "{part}: {error}");
        let found = std::iter::repeat_with(|| training.step()).take(100).find_map(Result::err).expect(part);
        assert!(matches!(found, TrainError::NotFinite(41..=140)), "{part}: {found}");
        let error = training.checkpoint(Value::Null).err().unwrap();
        assert!(matches!(error, TrainError::Unfinished(_)), "{part}: {error}");
        // Back to the good state, and on.
        training.restore(&good).unwrap();
        if part == "network" {
            run(&mut training, 50);
            assert!(model(&training) == model(&sound), "another model");
        }
    }
}

/// After lower rates the training moves less.
#[test]
fn a_slower_training_moves_less() {
    let dataset = dataset();
    let mut training = trainer(&dataset, &everything(60));
    run(&mut training, 22);
    let good = training.checkpoint(Value::Null).unwrap();
    let mut moved = |part: f64| {
        training.restore(&good).unwrap();
        training.slow_down(part);
        let kept = training.checkpoint(Value::Null).unwrap();
        training = resumed(&dataset, &kept);
        run(&mut training, 26);
        let now = model(&training).0;
        let distances = good.gaussians.means.as_flattened().iter().zip(now.means.as_flattened());
        distances.map(|(a, b)| f64::from((a - b).abs())).sum::<f64>()
    };
    let [full, half] = [1.0, 0.5].map(&mut moved);
    assert!(half > 0.3 * full && half < 0.7 * full, "{half} of {full}");
}
