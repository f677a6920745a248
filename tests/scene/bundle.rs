//! One-file bundles: everything comes back, and damage is told in a sentence.

use super::{output, random_gaussians};
use ibgs_core::bundle::{Bundle, BundleError};
use ibgs_core::config::TrainConfig;
use ibgs_core::dataset::Photo;
use ibgs_core::exposure::Exposure;
use ibgs_core::output::{cameras, multi_view};
use ibgs_core::sources::find::SourceOptions;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::fs;
use std::path::Path;
use std::sync::Arc;

/// A model of three views; the first training photo has transparent pixels.
fn bundle() -> Bundle {
    let mut dataset = output::dataset();
    let mut rng = ChaCha8Rng::seed_from_u64(21);
    for (index, view) in dataset.views.iter_mut().enumerate() {
        let mut photo = Photo::clone(&view.photo);
        rng.fill(&mut photo.rgba[..]);
        if index != 1 {
            photo.rgba.chunks_exact_mut(4).for_each(|pixel| pixel[3] = 255);
        }
        view.photo = Arc::new(photo);
    }
    let photo = |&index: &usize| (dataset.views[index].name.clone(), dataset.views[index].photo.clone());
    Bundle {
        iteration: 123,
        gaussians: random_gaussians(17, 2, 22),
        network: Some((0..5_000).map(|_| rng.random()).collect()),
        exposure: None,
        cameras: cameras::records(&dataset),
        config: TrainConfig { seed: 9, ..TrainConfig::default() },
        photos: dataset.train.iter().map(photo).collect(),
        sources: multi_view::records(&dataset, &SourceOptions::default()),
    }
}

fn written(bundle: &Bundle) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("deep/model.ibgs");
    bundle.write(&path).unwrap();
    fs::read(path).unwrap()
}

fn read(bytes: &[u8]) -> Result<Bundle, BundleError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.ibgs");
    fs::write(&path, bytes).unwrap();
    Bundle::read(&path)
}

#[test]
fn bundle_round_trip() {
    let bundle = bundle();
    let bytes = written(&bundle);
    let back = read(&bytes).unwrap();
    assert_eq!((back.iteration, &back.gaussians, &back.network), (123, &bundle.gaussians, &bundle.network));
    assert_eq!((&back.cameras, &back.config, &back.sources), (&bundle.cameras, &bundle.config, &bundle.sources));
    assert_eq!(back.photos.len(), 2);
    for ((name, photo), (expected_name, expected)) in back.photos.iter().zip(&bundle.photos) {
        assert_eq!((name, photo.width, photo.height), (expected_name, 64, 48));
        assert!(photo.rgba == expected.rgba, "{name}: pixels differ");
    }
    assert!(written(&back) == bytes, "equal models make equal files");
    let exposure = Exposure { log_gain: [0.0, 0.5, -0.25], offset: [0.125, 0.0, -0.5] };
    let exposures = Some([("a.png".to_owned(), exposure), ("b.png".to_owned(), Exposure::default())].into());
    let plain = Bundle { network: None, exposure: exposures, ..bundle };
    let back = read(&written(&plain)).unwrap();
    assert_eq!((back.network, back.exposure), (None, plain.exposure));
}

#[test]
fn damaged_bundles_are_refused_in_one_sentence() {
    let bundle = bundle();
    let bytes = written(&bundle);
    let refused = |bytes: &[u8]| {
        let text = read(bytes).unwrap_err().to_string();
        assert!(text.contains("model.ibgs") && !text.contains('\n'), "{text}");
        text
    };
    for length in [0, 1, 100, bytes.len() / 2, bytes.len() - 1] {
        assert!(refused(&bytes[..length]).contains("copy or export it again"));
    }
    assert!(refused(b"something else altogether").contains("no whole"));
    // A flipped bit in every region of the file.
    let mut named = 0;
    for at in (30..bytes.len()).step_by(bytes.len() / 60) {
        let mut damaged = bytes.clone();
        damaged[at] ^= 4;
        if let Err(error) = read(&damaged) {
            named += usize::from(error.to_string().contains("is damaged: its `"));
        }
    }
    println!("{named} of 60 flipped bits were told with their part");
    assert!(named >= 55);
    // Photos of other views than the cameras'.
    let mut other = bundle.clone();
    other.photos[1].0 = "left/d.png".to_owned();
    assert!(refused(&written(&other)).contains("`photos/left/c.png.png` is missing"));
    let small = Photo { width: 2, height: 1, rgba: vec![7; 8] };
    other.photos[1] = ("left/c.png".to_owned(), Arc::new(small));
    assert!(refused(&written(&other)).contains("2 x 1 pixels, its camera 64 x 48"));
    let text = Bundle::read(Path::new("nowhere.ibgs")).unwrap_err().to_string();
    assert!(text.contains("nowhere.ibgs") && text.contains("check the path"), "{text}");
}
