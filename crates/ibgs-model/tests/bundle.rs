//! One-file bundles: everything comes back, and damage is told in a sentence.

use crate::output;
use glam::{DVec3, Vec3};
use ibgs_data::dataset::{HostPhoto, Photo};
use ibgs_data::local_space::LocalSpace;
use ibgs_model::bundle::{Bundle, BundleError, Packing};
use ibgs_model::config::TrainConfig;
use ibgs_model::ensemble::Member;
use ibgs_model::output::cameras::Split;
use ibgs_model::output::{cameras, multi_view};
use ibgs_render::exposure::Exposure;
use ibgs_render::sources::find::SourceOptions;
use ibgs_shaders::layers::WEIGHTS;
use ibgs_testing::random_gaussians;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::fs;
use std::path::Path;
use std::sync::Arc;

fn pixels(photo: &HostPhoto) -> Arc<Photo> {
    photo.pixels().unwrap()
}

/// A model of three views; the first training photo has transparent pixels.
fn bundle() -> Bundle {
    let mut dataset = output::dataset();
    let mut rng = ChaCha8Rng::seed_from_u64(21);
    for (index, view) in dataset.views.iter_mut().enumerate() {
        let mut photo = Photo::clone(&view.photo.pixels().unwrap());
        rng.fill(&mut photo.rgba[..]);
        if index != 1 {
            photo.rgba.chunks_exact_mut(4).for_each(|pixel| pixel[3] = 255);
        }
        view.photo = photo.into();
    }
    let photo = |&index: &usize| (dataset.views[index].name.clone(), dataset.views[index].photo.clone());
    Bundle {
        iteration: 123,
        gaussians: random_gaussians(17, 2, 22),
        members: Vec::new(),
        levels: None,
        network: Some((0..5_000).map(|_| rng.random()).collect()),
        exposure: None,
        cameras: cameras::records(&dataset),
        config: TrainConfig { seed: 9, ..TrainConfig::default() },
        photos: dataset.train.iter().map(photo).collect(),
        sources: multi_view::records(&dataset, &SourceOptions::default()),
    }
}

fn written(bundle: &Bundle) -> Vec<u8> {
    packed(bundle, Packing::Lossless)
}

fn packed(bundle: &Bundle, packing: Packing) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("deep/model.ibgs");
    bundle.write(&path, packing).unwrap();
    fs::read(path).unwrap()
}

fn read(bytes: &[u8]) -> Result<Bundle, BundleError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.ibgs");
    fs::write(&path, bytes).unwrap();
    Bundle::read(&path)
}

/// Every member comes back: its Gaussians, with planes where it has a network, and its exposures.
#[test]
fn an_ensemble_round_trip() {
    let mut bundle = bundle();
    bundle.config = TrainConfig { ensemble: Some(3), ..TrainConfig::default() };
    bundle.config.residual.networks = 2;
    let network: Vec<f32> = (0..WEIGHTS).map(|i| i as f32 * 1e-4).collect();
    let exposure = bundle.photos.iter().map(|(name, _)| (name.clone(), Exposure::default())).collect();
    let mut plain = random_gaussians(9, 3, 24);
    plain.normals.fill([0.0, 0.0, 1.0]);
    plain.offsets.fill(0.0);
    bundle.members = vec![
        Member { gaussians: random_gaussians(12, 2, 23), network: Some(network), exposure: Some(exposure) },
        Member { gaussians: plain, network: None, exposure: None },
    ];
    let lossless = read(&written(&bundle)).unwrap();
    let small = read(&packed(&bundle, Packing::Small { photo_quality: 90 })).unwrap();
    for back in [&lossless, &small] {
        assert_eq!(back.config, bundle.config);
        assert_eq!(back.members.len(), 2);
        for (member, expected) in back.members.iter().zip(&bundle.members) {
            assert_eq!(member.gaussians.len(), expected.gaussians.len());
            assert_eq!(member.gaussians.sh_degree, expected.gaussians.sh_degree);
            assert_eq!((&member.network, &member.exposure), (&expected.network, &expected.exposure));
            assert_eq!(member.gaussians.lacks_planes(), expected.network.is_none());
        }
    }
    assert!(lossless.members.iter().zip(&bundle.members).all(|(back, own)| back.gaussians == own.gaussians));
    // Levels of detail are those of the first.
    let levels = read(&packed(&bundle, Packing::Levels)).unwrap();
    assert!(levels.members.is_empty() && levels.config.ensemble() == 1 && levels.network == bundle.network);
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
        assert_eq!((name, photo.size()), (expected_name, [64, 48]));
        assert!(pixels(photo).rgba == pixels(expected).rgba, "{name}: pixels differ");
    }
    assert!(written(&back) == bytes, "equal models make equal files");
    let exposure = Exposure { log_gain: [0.0, 0.5, -0.25], offset: [0.125, 0.0, -0.5] };
    let exposures = Some([("a.png".to_owned(), exposure), ("b.png".to_owned(), Exposure::default())].into());
    let plain = Bundle { network: None, exposure: exposures, ..bundle };
    let back = read(&written(&plain)).unwrap();
    assert_eq!((back.network, back.exposure), (None, plain.exposure));
}

#[test]
fn small_bundle_round_trip() {
    let mut bundle = bundle();
    // As smooth as photos are, but for the one with transparent pixels.
    for (name, photo) in &mut bundle.photos {
        if pixels(photo).rgba.chunks_exact(4).all(|pixel| pixel[3] == 255) {
            let [width, height] = photo.size();
            let smooth = (0..height).flat_map(|y| (0..width).map(move |x| [(3 * x) as u8, (5 * y) as u8, 90, 255]));
            *photo = Photo { width, height, rgba: smooth.flatten().collect() }.into();
            assert_eq!(name, "left/c.png");
        }
    }
    bundle.gaussians.space = LocalSpace::at(DVec3::new(5e6, -4e6, 0.0));
    let bytes = packed(&bundle, Packing::Small { photo_quality: 90 });
    let back = read(&bytes).unwrap();
    assert_eq!((&back.cameras, &back.config, &back.sources), (&bundle.cameras, &bundle.config, &bundle.sources));
    assert_eq!((back.iteration, &back.network, back.gaussians.space), (123, &bundle.network, bundle.gaussians.space));
    // They come back in another order; each mean has one beside it, with the same plane.
    assert_eq!(back.gaussians.len(), 17);
    for i in 0..17 {
        let mean = Vec3::from(bundle.gaussians.means[i]);
        let away = |&j: &usize| Vec3::from(back.gaussians.means[j]).distance(mean);
        let j = (0..17).min_by(|a, b| away(a).total_cmp(&away(b))).unwrap();
        let normal = Vec3::from(bundle.gaussians.normals[i]).normalize();
        let turned = Vec3::from(back.gaussians.normals[j]).angle_between(normal);
        assert!(away(&j) < 1e-3 && turned < 2e-3, "Gaussian {i}: {} away, turned by {turned}", away(&j));
        let scale = bundle.gaussians.log_scales[i].iter().fold(f32::NEG_INFINITY, |a, &b| a.max(b)).exp();
        let offset = (back.gaussians.offsets[j] - bundle.gaussians.offsets[i]).abs();
        assert!(
            offset < 0.01 * scale.max(bundle.gaussians.offsets[i].abs()),
            "Gaussian {i}: offset differs by {offset}"
        );
    }
    for ((_, photo), (name, expected)) in back.photos.iter().zip(&bundle.photos) {
        let (photo, expected) = (pixels(photo), pixels(expected));
        let most = photo.rgba.iter().zip(&expected.rgba).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
        assert!(most <= if name == "left/c.png" { 12 } else { 0 }, "{name}: differs by {most}");
    }
    begins_with_the_base_image(&bytes, &back);
    for part in ["gaussians.sog", "planes.bin", "photos/left/c.png.jpg"] {
        let at = bytes.windows(part.len()).position(|bytes| bytes == part.as_bytes()).unwrap() + part.len() + 25;
        let mut damaged = bytes.clone();
        damaged[at] ^= 4;
        let text = read(&damaged).unwrap_err().to_string();
        assert!(text.contains(&format!("is damaged: its `{part}`")), "{text}");
    }
}

/// Up to the spherical harmonics a small bundle gives the Gaussians in their constant colours, without planes.
fn begins_with_the_base_image(bytes: &[u8], whole: &Bundle) {
    // Behind the list of its pictures it stands in its own header.
    let name = b"shN_centroids.webp";
    let mut places = (0..bytes.len()).filter(|&at| bytes[at..].starts_with(name));
    let start = |length: usize| Bundle::read_start(&bytes[..length], Path::new("a.ibgs")).unwrap();
    let harmonics = places.nth(1).unwrap() + name.len();
    let base = start(harmonics).unwrap();
    assert_eq!((base.iteration, &base.cameras, &base.config), (whole.iteration, &whole.cameras, &whole.config));
    assert!(base.network.is_none() && base.photos.is_empty());
    let (found, expected) = (&base.gaussians, &whole.gaussians);
    assert_eq!((&found.means, &found.rotations, found.space), (&expected.means, &expected.rotations, expected.space));
    assert!(found.sh_degree == 0 && found.lacks_planes() && !expected.lacks_planes());
    let row = 3 * expected.sh_coefficients();
    let constant: Vec<f32> = expected.sh.chunks_exact(row).flat_map(|sh| &sh[..3]).copied().collect();
    assert_eq!(found.sh, constant);
    assert_eq!(start(bytes.len()).unwrap().gaussians, base.gaussians);
    for length in (0..harmonics).step_by(harmonics / 97).chain([harmonics - 1]) {
        assert!(start(length).is_none(), "{length} of {harmonics} bytes");
    }
}

#[test]
fn a_lossless_bundle_begins_with_its_gaussians() {
    let bundle = bundle();
    let bytes = written(&bundle);
    let at = bytes.windows(11).position(|bytes| bytes == b"network.bin").unwrap() - 30;
    let start = |length: usize| Bundle::read_start(&bytes[..length], Path::new("a.ibgs")).unwrap();
    assert_eq!(start(at).unwrap().gaussians, bundle.gaussians);
    assert!(start(at - 1).is_none() && start(0).is_none());
}

#[test]
fn photos_shrink_with_their_cameras() {
    let mut bundle = bundle();
    let cameras = bundle.cameras.clone();
    bundle.shrink_photos(64).unwrap();
    assert_eq!(bundle.cameras, cameras);
    bundle.shrink_photos(32).unwrap();
    for (now, before) in bundle.cameras.iter().zip(&cameras) {
        let is_small = before.split == Some(Split::Train);
        let expected = if is_small { before.camera.resized(32, 24) } else { before.camera };
        assert_eq!(now.camera, expected, "{}", now.name);
    }
    assert!(bundle.photos.iter().all(|(_, photo)| photo.size() == [32, 24]));
    assert_eq!(read(&written(&bundle)).unwrap().cameras, bundle.cameras);
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
    other.photos[1] = ("left/c.png".to_owned(), small.into());
    assert!(refused(&written(&other)).contains("2 x 1 pixels, its camera 64 x 48"));
    let text = Bundle::read(Path::new("nowhere.ibgs")).unwrap_err().to_string();
    assert!(text.contains("nowhere.ibgs") && text.contains("check the path"), "{text}");
}
