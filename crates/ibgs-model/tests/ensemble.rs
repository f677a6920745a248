//! Models of several bases.

use crate::levels::camera;
use crate::output;
use ibgs_data::scene::Gaussians;
use ibgs_model::bundle::{Bundle, Packing};
use ibgs_model::config::{Background, Method, TrainConfig};
use ibgs_model::ensemble::Member;
use ibgs_model::model::{Model, ModelOptions};
use ibgs_model::output::cameras;
use ibgs_reference::gpu::gpu;
use ibgs_testing::random_gaussians;
use std::path::Path;

/// The base image of a bundle of these bases.
fn base_image(path: &Path, bases: &[&Gaussians], packing: Packing) -> Vec<f32> {
    let dataset = output::dataset();
    let member =
        |gaussians: &&Gaussians| Member { gaussians: Gaussians::clone(gaussians), network: None, exposure: None };
    let photo = |&view: &usize| (dataset.views[view].name.clone(), dataset.views[view].photo.clone());
    let background = Some(Background::Color([51, 102, 204]));
    let bundle = Bundle {
        iteration: 1,
        gaussians: bases[0].clone(),
        members: bases[1..].iter().map(member).collect(),
        levels: None,
        network: None,
        exposure: None,
        cameras: cameras::records(&dataset),
        config: TrainConfig {
            method: Method::Gs3,
            ensemble: Some(bases.len() as u32),
            background,
            ..TrainConfig::default()
        },
        photos: dataset.train.iter().map(photo).collect(),
        sources: Vec::new(),
    };
    bundle.write(path, packing).unwrap();
    let mut model = Model::open(path, &ModelOptions::default()).unwrap();
    model.renderer(&gpu()).unwrap().showing_surface().render(&camera(0.0, -12.0)).unwrap().base().unwrap().rgb
}

/// As the editor leaves it: a base of which nothing is left stays one of those whose mean is the base image.
#[test]
fn a_base_without_gaussians_gives_the_background() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.ibgs");
    let (some, none) = (random_gaussians(300, 2, 5), Gaussians::with_capacity(0, 1));
    let background = base_image(&path, &[&none], Packing::Lossless);
    assert!(background.chunks(3).all(|pixel| pixel == [0.2, 0.4, 0.8]), "nothing but the background");
    let small = Packing::Small { photo_quality: 90 };
    for (bases, packing) in
        [([&some, &none], Packing::Lossless), ([&none, &some], Packing::Lossless), ([&some, &none], small)]
    {
        let alone = base_image(&path, &[&some], packing);
        assert!(alone != background);
        let mean = base_image(&path, &bases, packing);
        let expected = alone.iter().zip(&background).map(|(a, b)| 0.5 * (a + b));
        assert!(mean.iter().zip(expected).all(|(mean, expected)| (mean - expected).abs() < 1e-5), "{packing:?}");
    }
}
