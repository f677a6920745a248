//! The image-based stages in short trainings.

use crate::small::{dataset, model, plain, run, staged, trainer};
use ibgs_core::config::{Method, TrainConfig};
use ibgs_core::eval::score_view;
use ibgs_core::sources::find::Draw;
use ibgs_core::sources::memory::MemoryBudget;
use ibgs_reference::gpu::gpu;
use ibgs_testing::TINY;
use ibgs_train::Trainer;
use std::sync::Arc;

#[test]
fn every_stage_trains_what_it_should() {
    let dataset = dataset();
    let mut config = staged(50);
    config.residual.factor = None;
    let mut trainer = trainer(&dataset, &config);
    // Depths are kept from two epochs before the surface losses on, here from the first iteration: normals take shape.
    run(&mut trainer, 10);
    let (before, network) = model(&trainer);
    assert!(network.is_none(), "no residual yet");
    assert!(before.offsets.iter().all(|&offset| offset == 0.0), "no surface loss has moved the planes");
    assert!(before.normals.iter().any(|normal| *normal != [0.0, 0.0, 1.0]), "normals are the shortest axes");
    run(&mut trainer, 14);
    let (surface, _) = model(&trainer);
    assert!(surface.offsets.iter().any(|&offset| offset != 0.0), "the surface losses move the planes");
    run(&mut trainer, 50);
    let score = |&index: &usize| score_view(&trainer.renderer().unwrap(), &dataset.views[index], None).unwrap().1;
    let scores: Vec<_> = dataset.train.iter().map(score).collect();
    let base = scores.iter().map(|s| s.base.psnr).sum::<f64>() / scores.len() as f64;
    let image = scores.iter().map(|s| s.image.unwrap().psnr).sum::<f64>() / scores.len() as f64;
    println!("training views: base {base:.2} dB, final {image:.2} dB");
    let (frame, _) = score_view(&trainer.renderer().unwrap(), &dataset.views[dataset.train[2]], None).unwrap();
    assert!(image > base, "the residual must help: base {base:.2} dB, final {image:.2} dB");
    let visibility = frame.visibility().unwrap().unwrap();
    assert!(visibility.contains(&0) || visibility.contains(&3), "{visibility:?}");
    assert!(frame.depth().unwrap().unwrap().iter().any(|&z| z > 0.0));
    assert!(!trainer.overflowed());
}

/// With the same seed also the network is the same, bit for bit, and so are frames and models when the photos have to be
/// streamed.
#[test]
fn runs_repeat_bit_for_bit_whatever_the_source_memory() {
    let dataset = dataset();
    let mut config = staged(26);
    config.residual.factor = None;
    let mut first = trainer(&dataset, &config);
    run(&mut first, 26);
    let expected = model(&first);
    assert!(expected.1.is_some());
    // Room for two of 28 photos.
    let photo = 4 * u64::from(TINY[0] * TINY[1]);
    let mut streamed_config = config.clone();
    streamed_config.sources.memory = MemoryBudget::Bytes(2 * photo);
    let mut streamed = trainer(&dataset, &streamed_config);
    run(&mut streamed, 26);
    assert!(expected == model(&streamed), "streamed sources gave another model");
    let frame = |trainer: &Trainer| {
        trainer
            .renderer()
            .unwrap()
            .render(&dataset.views[dataset.test[0]].camera)
            .unwrap()
            .image()
            .unwrap()
            .unwrap()
            .rgb
    };
    let (ours, theirs) = (frame(&first), frame(&streamed));
    assert!(ours == theirs && ours.iter().any(|&v| v > 0.0), "streamed sources gave another frame");
}

/// Depth maps that were dropped are rendered again: another model, but one that learns all the same.
#[test]
fn depth_maps_may_be_dropped() {
    let dataset = dataset();
    let mut config = staged(26);
    let mut all = trainer(&dataset, &config);
    run(&mut all, 26);
    config.surface.depth_memory = MemoryBudget::Bytes(2 * 4 * u64::from(TINY[0] * TINY[1]));
    let mut few = trainer(&dataset, &config);
    run(&mut few, 26);
    let ((gaussians, network), (others, other)) = (model(&all), model(&few));
    assert!(gaussians != others && network != other && other.is_some(), "the limit changed nothing");
    let psnr = |trainer: &Trainer| {
        let view = &dataset.views[dataset.train[0]];
        score_view(&trainer.renderer().unwrap(), view, None).unwrap().1.base.psnr
    };
    let (usual, limited) = (psnr(&all), psnr(&few));
    assert!((usual - limited).abs() < 1.0, "{usual} dB and {limited} dB");
}

/// Drawing other sources each time makes another network than reading the nearest ones; without more candidates than are
/// read both are the same.
#[test]
fn sources_are_drawn_among_the_candidates() {
    let dataset = dataset();
    let network = |draw, neighbours| {
        let mut config = staged(18);
        config.sources.draw = draw;
        config.sources.neighbours = neighbours;
        let mut trainer = trainer(&dataset, &config);
        run(&mut trainer, 18);
        model(&trainer).1.unwrap()
    };
    let nearest = network(Draw::Nearest, 4);
    assert!(nearest == network(Draw::Random, 4));
    assert!(nearest == network(Draw::Nearest, 8));
    assert!(nearest != network(Draw::Random, 8));
}

/// A finished model gets planes and a network; its Gaussians are neither densified nor reset.
#[test]
fn a_finished_model_is_a_start() {
    let dataset = dataset();
    let mut base = trainer(&dataset, &plain(40));
    run(&mut base, 40);
    let start = base.splats().download(&gpu()).unwrap();
    let config = TrainConfig { method: Method::Ibgs, init: Some("model.ply".into()), ..plain(40) };
    let config = TrainConfig { densify: Default::default(), opacity_reset: Default::default(), ..config };
    let raster = Arc::new(ibgs_reference::gpu::rasterizer());
    let mut warm = Trainer::from_gaussians(raster, &dataset, &config, &start).unwrap();
    run(&mut warm, 40);
    let (after, network) = model(&warm);
    assert_eq!(after.len(), start.len());
    assert!(network.is_some() && after.normals != start.normals);
    let view = &dataset.views[dataset.train[2]];
    let scores = score_view(&warm.renderer().unwrap(), view, None).unwrap().1;
    let before = score_view(&base.renderer().unwrap(), view, None).unwrap().1.base.psnr;
    let image = scores.image.unwrap().psnr;
    println!("training view: {before:.2} dB before, final {image:.2} dB");
    assert!(image > before, "{before:.2} dB before, final {image:.2} dB");
    gpu().wait().unwrap();
}
