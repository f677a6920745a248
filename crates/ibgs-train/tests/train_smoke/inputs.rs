//! Photos and models of every kind train.

use super::{dataset, densifying, psnr, trained};
use crate::small::{plain, run, trainer};
use glam::DVec2;
use ibgs_core::config::{Background, TrainConfig};
use ibgs_core::dataset::{Dataset, Photo, View};
use ibgs_reference::gpu::gpu;

/// Replaces the photos; `pixel` gets the view, the pixel's column and row, and its RGBA bytes.
fn repainted(dataset: &Dataset, pixel: impl Fn(usize, u32, u32, &mut [u8])) -> Dataset {
    let mut dataset = dataset.clone();
    for (index, view) in dataset.views.iter_mut().enumerate() {
        let mut photo = Photo::clone(&view.photo.pixels().unwrap());
        for (i, rgba) in (0u32..).zip(photo.rgba.chunks_exact_mut(4)) {
            pixel(index, i % photo.width, i / photo.width, rgba);
        }
        view.photo = photo.into();
    }
    dataset
}

#[test]
fn what_a_mask_covers_does_not_matter() {
    let dataset = dataset();
    let config = densifying(25, 25);
    let masked = |red: u8| {
        repainted(&dataset, |view, x, y, rgba| {
            if (x + view as u32) % 32 < 13 && y > 7 {
                rgba.copy_from_slice(&[red, 255 - red, y as u8, 0]);
            }
        })
    };
    let first = trained(&masked(0), &config);
    assert!(first == trained(&masked(255), &config), "masked pixels reached the model");
    let open = repainted(&masked(255), |_, _, _, rgba| rgba[3] = 255);
    assert!(first != trained(&open, &config), "the mask made no difference");
    let opposite = |alpha: u8| repainted(&dataset, |_, x, _, rgba| rgba[3] = if x < 20 { alpha } else { 255 });
    assert!(trained(&opposite(127), &config) == trained(&opposite(0), &config), "alpha under one half is masked");
    assert!(trained(&opposite(128), &config) == trained(&opposite(255), &config), "alpha from one half on is not");
}

/// The same through all stages: normal and photometric loss, warping of the sources, residual.
#[test]
fn what_a_mask_covers_does_not_matter_to_other_views() {
    let (dataset, config) = (crate::small::dataset(), crate::small::staged(24));
    let masked = |red: u8, alpha: u8| {
        repainted(&dataset, |view, x, y, rgba| {
            if (x + 5 * view as u32) % 32 < 11 && y > 5 {
                rgba.copy_from_slice(&[red, 255 - red, y as u8, alpha]);
            }
        })
    };
    let all = |dataset: &Dataset| {
        let mut trainer = trainer(dataset, &config);
        run(&mut trainer, config.iterations());
        crate::small::model(&trainer)
    };
    let first = all(&masked(0, 127));
    assert!(first == all(&masked(255, 0)), "masked pixels reached the model or the network");
    assert!(first != all(&masked(255, 255)), "the mask made no difference");
}

#[test]
fn the_background_can_be_white() {
    let white = repainted(&dataset(), |_, _, _, rgba| rgba.fill(255));
    let config = TrainConfig { background: Some(Background::WHITE), ..plain(40) };
    let view = &white.views[white.train[0]];
    let after = |config: &TrainConfig| {
        let mut trainer = trainer(&white, config);
        assert_eq!(trainer.background(), [f32::from(u8::from(config.background.is_some())); 3]);
        run(&mut trainer, 40);
        psnr(&trainer, view)
    };
    let (on_white, on_black) = (after(&config), after(&plain(40)));
    println!("white photos: {on_white:.2} dB on white, {on_black:.2} dB on black");
    assert!(on_white > on_black + 6.0, "{on_white:.2} dB on white, {on_black:.2} dB on black");
    // Its own opacity reset, when densification starts.
    let mut config = TrainConfig { background: Some(Background::WHITE), ..densifying(12, 12) };
    config.densify.start = Some(8);
    let mut trainer = trainer(&white, &config);
    assert!((1..=12).filter(|&i| trainer.schedule().reset_opacity_at(i)).eq([8]));
    // It comes before the ninth step, which moves the logits by at most their rate.
    run(&mut trainer, 9);
    let logits = trainer.splats().download(&gpu()).unwrap().opacity_logits;
    assert!(logits.iter().all(|&logit| logit <= (0.01f32 / 0.99).ln() + 0.0251));
}

#[test]
fn every_degree_of_the_spherical_harmonics_trains() {
    let dataset = dataset();
    for degree in [0, 3] {
        let mut config = TrainConfig { sh_degree: Some(degree), ..plain(40) };
        config.sh_interval = Some(10);
        let mut trainer = trainer(&dataset, &config);
        // The degree goes up at 10, 20 and 30, and no coefficient beyond it moves before.
        for until in [9, 19, 29, 40] {
            run(&mut trainer, until);
            let model = trainer.splats().download(&gpu()).unwrap();
            assert_eq!(model.sh_degree, degree);
            let coefficients = model.sh_coefficients();
            let in_use = (until / 10).min(degree) + 1;
            for k in 0..coefficients {
                let moved = model.sh.chunks_exact(3 * coefficients).any(|row| row[3 * k..3 * k + 3] != [0.0; 3]);
                assert_eq!(moved, k < (in_use * in_use) as usize, "coefficient {k} after {until} iterations");
            }
        }
    }
}

/// The demo's views as three cameras took them: other sizes, other lenses, principal points far from the centre.
fn three_cameras() -> Dataset {
    let mut dataset = dataset();
    for (index, view) in dataset.views.iter_mut().enumerate() {
        let camera = &mut view.camera;
        match index % 3 {
            0 => camera.principal += DVec2::new(9.0, -6.0),
            1 => {
                (camera.width, camera.height) = (33, 50);
                camera.principal = DVec2::new(12.5, 30.0);
            }
            _ => camera.focal *= DVec2::new(0.8, 0.9),
        }
        view.photo = ibgs_demo::render_photo(camera, 1).into();
    }
    dataset
}

#[test]
fn several_cameras_with_their_own_principal_points_train() {
    let dataset = three_cameras();
    let mut trainer = trainer(&dataset, &densifying(100, 60));
    let views: Vec<&View> = dataset.train.iter().take(3).map(|&i| &dataset.views[i]).collect();
    let before: Vec<f64> = views.iter().map(|view| psnr(&trainer, view)).collect();
    run(&mut trainer, 100);
    let (mut own, mut centred) = (0.0, 0.0);
    for (view, before) in views.iter().zip(before) {
        let after = psnr(&trainer, view);
        assert!(after > before + 1.5, "{}: {before:.2} to {after:.2} dB", view.name);
        own += after;
        centred += psnr(&trainer, &View { camera: view.camera.centred(), ..(*view).clone() });
    }
    // The same photos from the image centre: the principal points are used, not only stored.
    println!("sum of PSNR: {own:.2} dB, {centred:.2} dB from the image centre");
    assert!(own > centred + 1.0, "{own:.2} dB, {centred:.2} dB from the image centre");
}
