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
    let mut config = TrainConfig { ensemble: 3, deterministic: true, ..staged(iterations) };
    config.exposure.enabled = ExposureSwitch::On;
    config.exposure.from = Some(5);
    config
}

fn members(trainer: &Trainer) -> Vec<Gaussians> {
    trainer.members().iter().map(|member| member.splats().download(&gpu()).unwrap()).collect()
}

/// The base image is the mean of those of the members, each of which is another model, and the residual lies over it.
#[test]
fn the_base_image_is_the_mean_of_those_of_the_members() {
    let dataset = dataset();
    let mut trainer = trainer(&dataset, &config(24));
    run(&mut trainer, 24);
    let [second, third] = &members(&trainer)[..] else { panic!("two further members") };
    assert!(second.means != third.means && second.sh_degree == 3, "members are models of their own");
    let renderer = trainer.renderer().unwrap();
    for view in [dataset.train[3], dataset.test[0]] {
        let camera = &dataset.views[view].camera;
        let frame = |renderer: &Renderer| renderer.render(camera).unwrap();
        let base = |renderer: &Renderer| frame(renderer).base().unwrap().rgb;
        let others: Vec<Vec<f32>> = renderer.members().iter().map(base).collect();
        let alone = frame(&trainer.renderer().unwrap().with_members(Vec::new()));
        let [alone, own] = [alone.image().unwrap().unwrap().rgb, alone.base().unwrap().rgb];
        let frame = frame(&renderer);
        let (mean, image) = (frame.base().unwrap().rgb, frame.image().unwrap().unwrap().rgb);
        for (i, (&mean, &image)) in mean.iter().zip(&image).enumerate() {
            let expected = [(own[i] + others[0][i] + others[1][i]) / 3.0, alone[i] + mean - own[i]];
            let off = [mean - expected[0], image - expected[1]];
            assert!(off.iter().all(|off| off.abs() < 1e-5), "value {i}: {mean}, {image} in place of {expected:?}");
        }
        assert!(own != others[0] && others[0] != others[1] && mean != image);
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
    let single = TrainConfig { ensemble: 1, ..several.clone() };
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
    assert_eq!(checkpoint.members.len(), 2);
    let mut resumed = Trainer::resume(Arc::new(rasterizer()), &dataset, &checkpoint).unwrap();
    run(&mut resumed, 28);
    assert!(model(&resumed) == model(&whole), "another model");
    assert!(members(&resumed) == members(&whole), "other members");
    let mut fewer = checkpoint;
    fewer.members.pop();
    assert!(Trainer::resume(Arc::new(rasterizer()), &dataset, &fewer).err().unwrap().to_string().contains("members"));
}
