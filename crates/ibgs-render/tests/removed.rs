//! What photos hide of an edited model, against sums of the twin's blending weights.

use ibgs_data::camera::Camera;
use ibgs_data::dataset::{HostPhoto, Photo};
use ibgs_reference::Params;
use ibgs_reference::gpu::{gaussians, rasterizer, splats};
use ibgs_reference::random_scene::{random_camera, random_params};
use ibgs_reference::raster::{contributions, render, tile_pixels};
use ibgs_render::render::Renderer;
use std::sync::Arc;

/// White where the Gaussian was removed, black elsewhere.
fn marked(p: Params, is_removed: impl Fn(usize) -> bool) -> Params {
    // The constant basis function of the spherical harmonics.
    let value = |i: usize| if is_removed(i) { 0.5 } else { -0.5 } / 0.282_094_791_773_878_14;
    let sh = (0..p.len()).flat_map(|i| [value(i); 3]).collect();
    Params { sh, sh_degree: 0, ..p }
}

/// Part of each pixel's light that comes from removed Gaussians.
fn parts(p: &Params, camera: &Camera, is_removed: impl Fn(usize) -> bool) -> Vec<f64> {
    let forward = render(p, camera, [0.0; 3], 0);
    let mut parts = vec![0.0; camera.pixels()];
    for (tile, list) in forward.order.iter().enumerate() {
        for (x, y) in tile_pixels(camera, tile) {
            let found = contributions(&forward.projected, list, x, y).0.into_iter();
            let weights = found.filter(|part| is_removed(part.gaussian)).map(|part| part.alpha * part.transmittance);
            parts[(y * camera.width + x) as usize] = weights.sum();
        }
    }
    parts
}

/// A photo of a camera; some of its pixels are masked.
fn photo(camera: &Camera) -> Photo {
    let texel = |i: usize| [(i % 251) as u8, 7, 90, if i % 5 == 2 { 127 } else { 200 }];
    Photo { width: camera.width, height: camera.height, rgba: (0..camera.pixels()).flat_map(texel).collect() }
}

#[test]
fn pixels_are_hidden_where_a_quarter_of_their_light_was_removed_in_the_mean_over_the_bases() {
    let is_removed: [fn(usize) -> bool; 2] = [|i| i % 3 == 0, |i| i < 40];
    let bases: [Params; 2] = std::array::from_fn(|n| marked(random_params(300, 0, 5 + n as u64), is_removed[n]));
    let renderer = Renderer::new(Arc::new(rasterizer()), splats(&bases[0]), [0.2, 0.4, 0.6], None);
    let removed = renderer.removed(&bases.each_ref().map(gaussians)).unwrap();
    let camera = random_camera(90, 70, 3);
    let photo = photo(&camera);
    let hidden = removed.hide(&camera, &HostPhoto::from(photo.clone())).unwrap().unwrap();
    let [first, second] = [0, 1].map(|n| parts(&bases[n], &camera, is_removed[n]));
    let mut counts = [0; 2];
    let texels = photo.rgba.as_chunks::<4>().0.iter().zip(hidden.rgba.as_chunks::<4>().0);
    for (pixel, ((before, after), part)) in
        texels.zip(first.iter().zip(&second).map(|(a, b)| (a + b) / 2.0)).enumerate()
    {
        assert_eq!(before[..3], after[..3], "the colours of pixel {pixel}");
        // Within rounding of the limit a pixel falls on either side.
        if (part - 0.25).abs() > 1e-3 {
            let is_hidden = part > 0.25;
            assert_eq!(after[3], if is_hidden { 0 } else { before[3] }, "pixel {pixel}, of which {part} was removed");
            counts[usize::from(is_hidden)] += 1;
        }
    }
    assert!(counts.iter().all(|count| *count > 500), "{counts:?} pixels stay and are hidden");
}

#[test]
fn a_photo_that_shows_nothing_of_it_stays() {
    let p = marked(random_params(300, 0, 5), |_| false);
    let renderer = Renderer::new(Arc::new(rasterizer()), splats(&p), [1.0; 3], None);
    let removed = renderer.removed(&[gaussians(&p)]).unwrap();
    let camera = random_camera(64, 48, 8);
    assert!(removed.hide(&camera, &photo(&camera).into()).unwrap().is_none());
}
