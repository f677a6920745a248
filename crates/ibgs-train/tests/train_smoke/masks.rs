//! Masks of an object: what lies outside of them stays empty.

use super::{dataset, densifying};
use crate::small::{run, trainer};
use ibgs_core::config::{ExposureSwitch, Method, TrainConfig};
use ibgs_core::dataset::{Dataset, Masks, Photo, View};
use ibgs_core::eval::score;
use ibgs_core::render::Renderer;
use ibgs_core::scene::Splats;
use ibgs_reference::gpu::{gpu, rasterizer};
use ibgs_train::Trainer;
use ibgs_train::checkpoint::Checkpoint;
use serde_json::Value;
use std::sync::Arc;

/// Which pixels show what stands on the table.
fn silhouette(view: &View) -> Vec<bool> {
    ibgs_demo::truth(&view.camera).object.iter().map(|id| (2..8).contains(id)).collect()
}

/// The dataset with these pixels alone; the others have the colour `outside`, or their own, and the alpha of emptiness.
fn masked(mut dataset: Dataset, outside: Option<u8>) -> Dataset {
    for view in &mut dataset.views {
        let inside = silhouette(view);
        let mut photo = Photo::clone(&view.photo.pixels().unwrap());
        for (pixel, _) in photo.rgba.chunks_exact_mut(4).zip(&inside).filter(|(_, inside)| !**inside) {
            pixel[3] = 1;
            if let Some(level) = outside {
                pixel[..3].fill(level);
            }
        }
        view.photo = photo.into();
    }
    dataset
}

/// Accumulated opacity of every pixel: what of a white background does not come through.
fn opacity(splats: &Splats, view: &View) -> Vec<f32> {
    let over = |level: f32| {
        let renderer = Renderer::new(Arc::new(rasterizer()), splats.clone(), [level; 3], None);
        renderer.render(&view.camera).unwrap().base().unwrap().rgb
    };
    let (white, black) = (over(1.0), over(0.0));
    white.chunks_exact(3).zip(black.chunks_exact(3)).map(|(white, black)| 1.0 - (white[0] - black[0])).collect()
}

/// Mean opacity inside and outside of the silhouettes of the held-out views, without the pixels at their outlines.
fn opacities(trainer: &Trainer, dataset: &Dataset) -> [f32; 2] {
    let mut sums = [[0.0, 0.0]; 2];
    for view in dataset.test.iter().map(|&index| &dataset.views[index]) {
        let (inside, opacity) = (silhouette(view), opacity(trainer.splats(), view));
        let width = view.camera.width as usize;
        let near = |at: usize, other: usize| {
            (at % width).abs_diff(other % width) <= 2 && (at / width).abs_diff(other / width) <= 2
        };
        for at in 0..inside.len() {
            let same = (0..inside.len()).filter(|&other| near(at, other)).all(|other| inside[other] == inside[at]);
            if same {
                let sum = &mut sums[usize::from(!inside[at])];
                *sum = [sum[0] + opacity[at], sum[1] + 1.0];
            }
        }
    }
    sums.map(|[sum, count]| sum / count)
}

fn with(masks: Masks, mut config: TrainConfig) -> TrainConfig {
    config.data.masks = Some(masks);
    config
}

/// PSNR of the base over all of the held-out views, the photos over black.
fn whole_psnr(trainer: &Trainer, dataset: &Dataset) -> f64 {
    let one = |&index: &usize| {
        let view = &dataset.views[index];
        let frame = trainer.renderer().unwrap().render(&view.camera).unwrap();
        score(&frame.base().unwrap(), &view.photo.pixels().unwrap().over([0.0; 3])).psnr
    };
    dataset.test.iter().map(one).sum::<f64>() / dataset.test.len() as f64
}

#[test]
fn what_lies_outside_of_an_object_is_empty() {
    let config = densifying(180, 60);
    let dataset = masked(dataset(), None);
    let after = |masks: Masks| {
        let mut trainer = trainer(&dataset, &with(masks, config.clone()));
        assert_eq!(trainer.background(), [0.0; 3]);
        run(&mut trainer, config.iterations());
        let [inside, outside] = opacities(&trainer, &dataset);
        let psnr = whole_psnr(&trainer, &dataset);
        println!("{masks:?}: opacity {inside:.3} inside, {outside:.4} outside, {psnr:.2} dB over black");
        (inside, outside, psnr)
    };
    let ignored = after(Masks::Ignore);
    let object = after(Masks::Object);
    assert!(object.1 < 0.06 && object.1 < 0.1 * ignored.1, "outside: {} of {}", object.1, ignored.1);
    assert!(object.0 > 0.8, "inside: {}", object.0);
    assert!(object.2 > ignored.2 + 3.0, "{} dB and {} dB", object.2, ignored.2);
}

/// Gaussians of the background's own colour are seen as well, by the quarter of the iterations over other colours.
#[test]
fn black_gaussians_do_not_hide_on_black() {
    let black = |masks: Masks, iterations: u32| {
        let mut dataset = masked(dataset(), Some(0));
        if masks == Masks::Ignore {
            // A picture of black in place of emptiness.
            dataset.views.iter_mut().for_each(|view| view.photo = view.photo.pixels().unwrap().over([0.0; 3]).into());
        }
        dataset.points.iter_mut().for_each(|point| point.color = [0; 3]);
        let mut trainer = trainer(&dataset, &with(masks, densifying(iterations, 80)));
        run(&mut trainer, iterations);
        opacities(&trainer, &dataset)[1]
    };
    let (picture, object) = (black(Masks::Ignore, 100), black(Masks::Object, 300));
    println!("opacity outside: {picture:.3} with a picture of black, {object:.4} with an object");
    assert!(object < 0.05 && object < 0.2 * picture, "{object} of {picture}");
}

/// In all stages: nothing is added where no source is seen, and the final image learns as the base does.
#[test]
fn the_residual_adds_nothing_to_emptiness() {
    let dataset = masked(crate::small::dataset(), None);
    for exposure in [ExposureSwitch::Off, ExposureSwitch::On] {
        let mut config = with(Masks::Object, crate::small::staged(40));
        config.exposure.enabled = exposure;
        config.exposure.from = Some(5);
        let mut trainer = trainer(&dataset, &config);
        run(&mut trainer, 40);
        let (mut unseen, mut changed, mut outside) = (0, 0, 0);
        for view in dataset.test.iter().map(|&index| &dataset.views[index]) {
            let frame = trainer.renderer().unwrap().render(&view.camera).unwrap();
            let (base, image) = (frame.base().unwrap().rgb, frame.image().unwrap().unwrap().rgb);
            let pixels = base.chunks_exact(3).zip(image.chunks_exact(3));
            let places = frame.visibility().unwrap().unwrap().into_iter().zip(silhouette(view));
            for ((base, image), (sources, inside)) in pixels.zip(places) {
                unseen += usize::from(sources == 0);
                outside += usize::from(sources == 0 && !inside);
                changed += usize::from(base != image);
                assert!(sources > 0 || base == image, "{base:?} became {image:?}");
            }
        }
        println!("exposure {exposure:?}: {unseen} pixels see no source, {outside} of them outside; {changed} differ");
        assert!(outside > 1000 && changed > 50, "{outside} outside, {changed} changed");
    }
}

#[test]
fn runs_with_an_object_repeat_and_resume_bit_for_bit() {
    let dataset = masked(crate::small::dataset(), None);
    let mut config = with(Masks::Object, crate::small::staged(24));
    config = TrainConfig { method: Method::Ibgs, deterministic: true, ..config };
    let mut whole = trainer(&dataset, &config);
    run(&mut whole, 24);
    let expected = crate::small::model(&whole);
    let mut first = trainer(&dataset, &config);
    run(&mut first, 18);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("18.ibgs");
    first.checkpoint(Value::Null).unwrap().write(&path).unwrap();
    let checkpoint = Checkpoint::read(&path).unwrap();
    let mut resumed = Trainer::resume(Arc::new(rasterizer()), &dataset, &checkpoint).unwrap();
    run(&mut resumed, 24);
    assert!(crate::small::model(&resumed) == expected, "the resumed run gave another model");
    gpu().wait().unwrap();
}
