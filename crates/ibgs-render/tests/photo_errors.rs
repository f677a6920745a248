//! The error of the base image by Gaussian, against sums over the twin's blending weights.

use ibgs_data::camera::Camera;
use ibgs_data::dataset::Photo;
use ibgs_reference::gpu::{rasterizer, splats};
use ibgs_reference::random_scene::{random_camera, random_image, random_params};
use ibgs_reference::raster::{contributions, render, tile_pixels};
use ibgs_reference::{Forward, Params};
use ibgs_render::render::{PhotoErrors, Renderer};
use std::sync::Arc;

const BACKGROUND: [f32; 3] = [0.2, 0.4, 0.6];
const COUNT: usize = 300;

fn renderer(p: &Params) -> Renderer {
    Renderer::new(Arc::new(rasterizer()), splats(p), BACKGROUND, None)
}

/// A photo with pixels that do not count.
fn photo(camera: &Camera, seed: u64) -> Photo {
    let colors = random_image(camera.width, camera.height, 0.0, 1.0, seed);
    let pixel = |(i, color): (usize, [f64; 3])| {
        let [r, g, b] = color.map(|value| (255.0 * value) as u8);
        [r, g, b, if i % 7 == 3 { 127 } else { 128 }]
    };
    let rgba = colors.into_iter().enumerate().flat_map(pixel).collect();
    Photo { width: camera.width, height: camera.height, rgba }
}

/// Weighted errors and weights by Gaussian; `base` is the image that is compared.
fn sums(of: &Forward, base: &[[f64; 3]], camera: &Camera, photo: &Photo) -> Vec<[f64; 2]> {
    let mut sums = vec![[0.0; 2]; of.projected.len()];
    for (tile, list) in of.order.iter().enumerate() {
        for (x, y) in tile_pixels(camera, tile) {
            let i = (y * camera.width + x) as usize;
            let pixel = &photo.rgba[4 * i..4 * i + 4];
            if pixel[3] < 128 {
                continue;
            }
            let error =
                (0..3).map(|c| (base[i][c].clamp(0.0, 1.0) - f64::from(pixel[c]) / 255.0).powi(2)).sum::<f64>() / 3.0;
            for part in contributions(&of.projected, list, x, y).0 {
                let weight = part.alpha * part.transmittance;
                sums[part.gaussian][0] += weight * error;
                sums[part.gaussian][1] += weight;
            }
        }
    }
    sums
}

fn twin(p: &Params, camera: &Camera) -> Forward {
    render(p, camera, BACKGROUND.map(f64::from), p.sh_degree)
}

fn check(ours: &[f32], sums: &[[f64; 2]]) {
    assert_eq!(ours.len(), sums.len());
    let (mut seen, mut unseen) = (0, 0);
    for (i, (ours, [error, weight])) in ours.iter().zip(sums).enumerate() {
        // Within rounding of the least alpha or of the last transmittance a pixel falls on either side.
        if *weight > 0.1 {
            let wanted = error / weight;
            assert!((f64::from(*ours) - wanted).abs() < 2e-3 * wanted, "Gaussian {i}: {ours} is not {wanted}");
            seen += 1;
        } else if *weight == 0.0 {
            assert!(ours.is_nan(), "Gaussian {i} is not seen, but has {ours}");
            unseen += 1;
        }
    }
    assert!(seen > sums.len() / 4 && unseen > 0, "{seen} seen, {unseen} unseen");
}

#[test]
fn errors_are_weighted_means_over_all_photos() {
    let mut p = random_params(COUNT, 2, 5);
    // One is nowhere near.
    p.means[7] = [1e4; 3];
    let renderer = renderer(&p);
    let mut errors = PhotoErrors::new(&renderer);
    assert!(errors.means().iter().all(|error| error.is_nan()) && errors.means().len() == COUNT);
    let mut all = vec![[0.0; 2]; COUNT];
    for (seed, (width, height)) in [(3, (90, 70)), (4, (33, 50))] {
        let camera = random_camera(width, height, seed);
        let photo = photo(&camera, seed);
        errors.add(&renderer, &camera, &photo).unwrap();
        let forward = twin(&p, &camera);
        let own = sums(&forward, &forward.image, &camera, &photo);
        all.iter_mut().zip(own).for_each(|(sum, own)| *sum = [sum[0] + own[0], sum[1] + own[1]]);
    }
    check(&errors.means(), &all);
}

#[test]
fn every_member_of_an_ensemble_is_judged_by_the_mean_image() {
    let members = [5, 6].map(|seed| {
        let mut p = random_params(COUNT, 1, seed);
        p.means[7] = [1e4; 3];
        p
    });
    let [first, second] = members.each_ref().map(renderer);
    let ensemble = first.with_members(vec![second], 2);
    let camera = random_camera(80, 60, 9);
    let photo = photo(&camera, 9);
    let mut errors = PhotoErrors::new(&ensemble);
    errors.add(&ensemble, &camera, &photo).unwrap();
    let forwards = members.each_ref().map(|p| twin(p, &camera));
    let mean = |(a, b): (&[f64; 3], &[f64; 3])| [0, 1, 2].map(|c| 0.5 * (a[c] + b[c]));
    let base: Vec<_> = forwards[0].image.iter().zip(&forwards[1].image).map(mean).collect();
    let sums = forwards.iter().flat_map(|forward| sums(forward, &base, &camera, &photo)).collect::<Vec<_>>();
    check(&errors.means(), &sums);
}

#[test]
fn an_image_that_is_its_photo_has_no_error() {
    let p = random_params(COUNT, 0, 8);
    let renderer = renderer(&p);
    let camera = random_camera(64, 48, 8);
    let base = renderer.render(&camera).unwrap().base().unwrap().to_rgb8();
    let rgba = base.as_chunks().0.iter().flat_map(|&[r, g, b]| [r, g, b, 255]).collect();
    let mut errors = PhotoErrors::new(&renderer);
    errors.add(&renderer, &camera, &Photo { width: 64, height: 48, rgba }).unwrap();
    let seen: Vec<f32> = errors.means().into_iter().filter(|error| error.is_finite()).collect();
    assert!(seen.len() > 50 && seen.iter().all(|error| *error < 1e-5), "{seen:?}");
}
