//! Several bases, whose mean is the base image.

use crate::small::{dataset, model, run, staged, trainer};
use ibgs_core::config::{ExposureSwitch, TrainConfig};
use ibgs_core::render::Renderer;
use ibgs_core::scene::Gaussians;
use ibgs_reference::gpu::{gpu, rasterizer};
use ibgs_train::Trainer;
use ibgs_train::checkpoint::Checkpoint;
use std::sync::Arc;

fn config(iterations: u32) -> TrainConfig {
    let mut config = TrainConfig { ensemble: Some(4), deterministic: true, ..staged(iterations) };
    config.residual.networks = 2;
    config.exposure.enabled = ExposureSwitch::On;
    config.exposure.from = Some(5);
    config
}

fn members(trainer: &Trainer) -> Vec<Gaussians> {
    trainer.members().iter().map(|member| member.splats().download(&gpu()).unwrap()).collect()
}

/// The base image is the mean of those of the members, each of which is another model, by half of those with a network, and the
/// mean of their residuals lies over it.
#[test]
fn the_base_image_is_the_mean_of_those_of_the_members() {
    let dataset = dataset();
    let mut trainer = trainer(&dataset, &config(24));
    run(&mut trainer, 24);
    let [second, third, fourth] = &members(&trainer)[..] else { panic!("three further members") };
    assert_eq!([second, third, fourth].map(|member| member.sh_degree), [2, 3, 3]);
    assert!(second.means != model(&trainer).0.means && third.means != fourth.means, "members are models of their own");
    let renderer = trainer.renderer().unwrap();
    for view in [dataset.train[3], dataset.test[0]] {
        let camera = &dataset.views[view].camera;
        let frame = |renderer: &Renderer| renderer.render(camera).unwrap();
        let base = |renderer: &Renderer| frame(renderer).base().unwrap().rgb;
        let image = |renderer: &Renderer| frame(renderer).image().unwrap().map(|image| image.rgb);
        let alone = trainer.renderer().unwrap().with_members(Vec::new(), 1);
        let all: Vec<&Renderer> = [&alone].into_iter().chain(renderer.members()).collect();
        let bases: Vec<Vec<f32>> = all.iter().map(|member| base(member)).collect();
        let images: Vec<_> = all.iter().map(|member| image(member)).collect();
        let [Some(first), Some(second), None, None] = &images[..] else { panic!("two members with a network") };
        for (i, (&mean, &image)) in base(&renderer).iter().zip(&image(&renderer).unwrap()).enumerate() {
            let expected = bases.iter().map(|base| base[i] / 4.0).sum::<f32>();
            let residual = (first[i] - bases[0][i] + second[i] - bases[1][i]) / 2.0;
            let off = [mean - expected, image - (expected + residual)];
            assert!(off.iter().all(|off| off.abs() < 1e-5), "value {i}: {mean}, {image}; off by {off:?}");
        }
        assert!(bases[0] != bases[1] && bases[2] != bases[3] && first != &bases[0] && first != second);
    }
}

/// Further members change nothing in the first.
#[test]
fn the_first_member_is_what_it_is_alone() {
    let dataset = dataset();
    let trained = |config: &TrainConfig| {
        let mut trainer = trainer(&dataset, config);
        run(&mut trainer, 20);
        model(&trainer)
    };
    let several = config(20);
    let single = several.of_member(1);
    assert!(trained(&several) == trained(&single), "another model");
}

/// A resumed ensemble is the uninterrupted one, bit for bit, with all members.
#[test]
fn an_ensemble_resumes_bit_for_bit() {
    let dataset = dataset();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("1.ibgs");
    let mut whole = trainer(&dataset, &config(28));
    run(&mut whole, 28);
    let mut training = trainer(&dataset, &config(28));
    run(&mut training, 17);
    training.checkpoint(serde_json::Value::Null).unwrap().write(&path).unwrap();
    let checkpoint = Checkpoint::read(&path).unwrap();
    assert_eq!(checkpoint.members.len(), 3);
    let mut resumed = Trainer::resume(Arc::new(rasterizer()), &dataset, &checkpoint).unwrap();
    run(&mut resumed, 28);
    assert!(model(&resumed) == model(&whole), "another model");
    assert!(members(&resumed) == members(&whole), "other members");
    let mut fewer = checkpoint;
    fewer.members.pop();
    assert!(Trainer::resume(Arc::new(rasterizer()), &dataset, &fewer).err().unwrap().to_string().contains("members"));
}
