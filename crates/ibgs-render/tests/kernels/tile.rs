//! The lists of the tiles that each Gaussian touches, against the twin.

use ibgs_reference::gpu::{assert_images_agree, rasterizer, render, splats};
use ibgs_reference::gpu::{background, view};
use ibgs_reference::random_scene::{random_camera, random_params};
use ibgs_reference::{self as reference, Model, Projected};
use ibgs_render::raster::RasterView;
use ibgs_shaders::TILE;

/// Without held ratios the tiles change nothing at all.
#[test]
fn tiles_cut_nothing() {
    let p = random_params(300, 2, 12);
    let camera = random_camera(90, 70, 12);
    let twin = reference::render_as(&p, &camera, background(), 2, Model::Ideal);
    let free = RasterView { tangent_limit: 1e6, ..view(camera, 2) };
    assert_images_agree("no box", &render(&p, &free), &twin.image, 2e-5);
}

/// Least -log(alpha / opacity) over the pixel centres of a tile and what lies between them.
fn least_falloff(tile: [u32; 2], p: &Projected) -> f64 {
    let lo = [0, 1].map(|i| f64::from(tile[i] * TILE) - p.xy[i]);
    let hi = lo.map(|lo| lo + f64::from(TILE - 1));
    if (0..2).all(|i| lo[i] <= 0.0 && hi[i] >= 0.0) {
        return 0.0;
    }
    let [a, b, c] = p.conic;
    let falloff = |x: f64, y: f64| 0.5 * (a * x * x + 2.0 * b * x * y + c * y * y);
    // It is convex, so it is least on the rim, and on each side where its derivative along the side is zero or at an end.
    let columns = [lo[0], hi[0]].map(|x| falloff(x, (-b * x / c).clamp(lo[1], hi[1])));
    let rows = [lo[1], hi[1]].map(|y| falloff((-b * y / a).clamp(lo[0], hi[0]), y));
    columns.into_iter().chain(rows).fold(f64::INFINITY, f64::min)
}

/// The lists have every tile of a Gaussian's box where its outline, alpha = 1/255, reaches, and no other: also for thin, huge
/// and faint Gaussians.
#[test]
fn tile_lists_follow_the_outline() {
    for seed in 0..6 {
        let mut p = random_params(400, 0, 40 + seed);
        for (i, scales) in p.log_scales.iter_mut().enumerate() {
            match i % 4 {
                0 => *scales = [-6.0, 0.5, -6.0],
                1 => *scales = [0.3, 0.1, -0.2],
                _ => {}
            }
        }
        for opacity in p.opacity_logits.iter_mut().step_by(7) {
            *opacity -= 5.0;
        }
        let camera = random_camera(310, 230, 40 + seed);
        let counted = rasterizer().count_intersections(&splats(&p), &view(camera, 0)).unwrap();
        // Rounding may decide only what lies within a thousandth of the outline, which is drawn a hundredth too wide.
        let (mut least, mut most) = (0, 0);
        for splat in reference::project(&p, &camera, 0).iter().filter(|splat| splat.visible) {
            let cut = (255.0 * splat.opacity).ln() + 0.01;
            let [x0, y0, x1, y1] = splat.rect;
            for tile in (y0..y1).flat_map(|y| (x0..x1).map(move |x| [x, y])) {
                let falloff = least_falloff(tile, splat);
                least += u64::from(falloff < cut - 1e-3);
                most += u64::from(falloff < cut + 1e-3);
            }
        }
        println!("{counted} intersections, from {least} to {most}");
        assert!((least..=most).contains(&counted), "{counted} intersections, from {least} to {most}");
        assert!(least > 1000 && most - least < 20, "from {least} to {most}");
    }
}
