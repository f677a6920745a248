//! Gaussians as opaque ellipsoids, against their twin.

use ibgs_reference::gpu::render;
use ibgs_reference::gpu::{background, view};
use ibgs_reference::random_scene::{random_camera, random_params};
use ibgs_reference::raster::ellipsoids;
use ibgs_reference::{Params, project};
use ibgs_render::raster::{RasterView, Shape};

fn shown(p: &Params, view: RasterView) -> Vec<f64> {
    render(p, &RasterView { shape: Shape::Ellipsoids, ..view })
}

#[test]
fn random_scenes_of_every_size_and_degree() {
    for (seed, (width, height)) in (0..).zip([(1, 1), (15, 7), (33, 17), (127, 95)]) {
        let degree = seed as usize % 4;
        let mut p = random_params(400, degree, seed);
        // Some are so faint that they end before the edge.
        p.opacity_logits.iter_mut().step_by(3).for_each(|logit| *logit = -5.0);
        let camera = random_camera(width, height, seed);
        let twin = ellipsoids(&project(&p, &camera, degree), &camera, background());
        let ours = shown(&p, view(camera, degree as u32));
        let certain = twin.iter().zip(ours.chunks_exact(3)).filter_map(|(twin, ours)| Some((twin.as_ref()?, ours)));
        let errors = certain.map(|(twin, ours)| (0..3).map(|c| (twin[c] - ours[c]).abs()).fold(0.0, f64::max));
        let errors: Vec<f64> = errors.collect();
        assert!(errors.len() * 10 >= twin.len() * 8, "{} of {} pixels lie on no edge", errors.len(), twin.len());
        let largest = errors.iter().copied().fold(0.0, f64::max);
        println!("{width} x {height}: {largest:.1e}");
        // Near an edge the shade is the root of a small difference.
        assert!(largest < 2e-3, "{width} x {height}: {largest:e}");
        assert_ne!(ours, render(&p, &view(camera, degree as u32)));
    }
}

#[test]
fn without_gaussians_the_background_is_left() {
    let empty = Params { sh_degree: 1, ..Params::default() };
    let image = shown(&empty, view(random_camera(20, 13, 13), 1));
    assert!(image.chunks_exact(3).all(|pixel| pixel == background()));
}
