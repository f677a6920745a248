//! Every gradient of the splatting twins against central finite differences.

use ibgs_data::camera::Camera;

use ibgs_reference::backward::rasterize_backward;
use ibgs_reference::finite::assert_gradient;
use ibgs_reference::random_scene::{Nasty, nasty_params, random_camera, random_image, random_params};
use ibgs_reference::raster::{contributions, tile_pixels};
use ibgs_reference::{Forward, MAX_ALPHA, Params, Tensor, backward, project, rasterize, relative_error, render};

const TOLERANCE: f64 = 1e-6;
const BACKGROUND: [f64; 3] = [0.3, 0.7, 0.1];

fn product(image: &[[f64; 3]], v_image: &[[f64; 3]]) -> f64 {
    image.as_flattened().iter().zip(v_image.as_flattened()).map(|(a, b)| a * b).sum()
}

/// What the scenes of this module must exercise, so that no branch of the backward pass goes untested.
#[derive(Debug, Default)]
struct Coverage {
    clamped_alpha: bool,
    clamped_color: bool,
    held_ratio: bool,
    culled: bool,
    stopped_early: bool,
}

impl Coverage {
    fn observe(&mut self, p: &Params, camera: &Camera, forward: &Forward) {
        for (i, g) in forward.projected.iter().enumerate() {
            let view = camera.to_view(p.means[i].into());
            let limit = 1.3 * f64::from(camera.width) / (2.0 * camera.focal.x);
            self.culled |= !g.visible;
            self.clamped_color |= g.visible && g.color.contains(&0.0);
            self.held_ratio |= g.visible && (view.x / view.z).abs() > limit;
            self.clamped_alpha |= g.visible && g.opacity > MAX_ALPHA;
        }
        for (tile, list) in forward.order.iter().enumerate() {
            for (x, y) in tile_pixels(camera, tile) {
                let behind = forward.last[(y * camera.width + x) as usize] as usize;
                let (unseen, _) = contributions(&forward.projected, &list[behind..], x, y);
                self.stopped_early |= !unseen.is_empty();
            }
        }
    }
}

fn scene(seed: u64, sh_degree: usize) -> (Params, Camera) {
    const CASES: [Nasty; 9] = [
        Nasty::BehindCamera,
        Nasty::Opaque,
        Nasty::OffScreen,
        Nasty::Dark,
        Nasty::Opaque,
        Nasty::Opaque,
        Nasty::LongRotation,
        Nasty::Needle,
        Nasty::Huge,
    ];
    let camera = random_camera(41, 29, seed);
    let mut p = nasty_params(14, sh_degree, seed, &camera, &CASES);
    // The opaque ones in front of one another, so that pixels stop early.
    for (i, x) in [(1, -0.0625), (4, 0.0), (5, 0.0625)] {
        p.means[i] = [x, 0.125, 2.0 * x];
        p.log_scales[i] = [-1.5, -1.25, -1.0];
    }
    (p, camera)
}

#[test]
fn every_tensor_agrees_with_finite_differences() {
    let mut coverage = Coverage::default();
    for (seed, sh_degree) in [(1, 0), (2, 1), (3, 2), (4, 3), (5, 3)] {
        let (p, camera) = scene(seed, sh_degree);
        let v_image = random_image(camera.width, camera.height, -1.0, 1.0, seed);
        let forward = render(&p, &camera, BACKGROUND, sh_degree);
        coverage.observe(&p, &camera, &forward);
        let grads = backward(&p, &camera, BACKGROUND, &forward, &v_image);
        for tensor in Tensor::ALL {
            let loss = |values: &[f64]| {
                let mut moved = p.clone();
                moved.get_mut(tensor).copy_from_slice(values);
                product(&render(&moved, &camera, BACKGROUND, sh_degree).image, &v_image)
            };
            let name = format!("seed {seed} {tensor:?}");
            let worst = assert_gradient(&name, p.get(tensor), grads.get(tensor), TOLERANCE, loss);
            println!("{name}: worst relative error {worst:.1e}");
        }
    }
    let Coverage { clamped_alpha, clamped_color, held_ratio, culled, stopped_early } = coverage;
    assert!(
        clamped_alpha && clamped_color && held_ratio && culled && stopped_early,
        "the scenes leave a branch untested: {coverage:?}"
    );
}

#[test]
fn what_the_blending_reads_agrees_with_finite_differences() {
    for seed in [11, 12] {
        let (p, camera) = scene(seed, 2);
        let v_image = random_image(camera.width, camera.height, -1.0, 1.0, seed);
        let projected = project(&p, &camera, 2);
        let forward = rasterize(projected.clone(), &camera, BACKGROUND, 2);
        let v = rasterize_backward(&camera, BACKGROUND, &forward, &v_image);
        let blend = |projected| product(&rasterize(projected, &camera, BACKGROUND, 2).image, &v_image);

        macro_rules! check {
            ($field:ident, $grad:expr, $get:expr, $set:expr) => {{
                let at: Vec<f64> = projected.iter().flat_map($get).collect();
                let loss = |values: &[f64]| {
                    let mut moved = projected.clone();
                    for (splat, v) in moved.iter_mut().zip(values.chunks(at.len() / projected.len())) {
                        $set(splat, v);
                    }
                    blend(moved)
                };
                let name = format!("seed {seed} {}", stringify!($field));
                assert_gradient(&name, &at, $grad, TOLERANCE, loss);
            }};
        }
        use ibgs_reference::Projected as P;
        check!(xy, v.xy.as_flattened(), |g: &P| g.xy, |g: &mut P, v: &[f64]| g.xy.copy_from_slice(v));
        check!(conic, v.conic.as_flattened(), |g: &P| g.conic, |g: &mut P, v: &[f64]| g.conic.copy_from_slice(v));
        check!(opacity, &v.opacity, |g: &P| [g.opacity], |g: &mut P, v: &[f64]| g.opacity = v[0]);
        check!(color, v.color.as_flattened(), |g: &P| g.color, |g: &mut P, v: &[f64]| g.color.copy_from_slice(v));
    }
}

#[test]
fn absolute_gradients_are_sums_over_single_pixels() {
    let p = random_params(12, 1, 21);
    let camera = random_camera(23, 19, 21);
    let v_image = random_image(camera.width, camera.height, -1.0, 1.0, 21);
    let forward = render(&p, &camera, BACKGROUND, 1);
    let all = rasterize_backward(&camera, BACKGROUND, &forward, &v_image);
    let mut signed = vec![0.0; 2 * p.len()];
    let mut absolute = vec![0.0; 2 * p.len()];
    for pixel in 0..v_image.len() {
        let mut v_one = vec![[0.0; 3]; v_image.len()];
        v_one[pixel] = v_image[pixel];
        let one = rasterize_backward(&camera, BACKGROUND, &forward, &v_one);
        for (i, v) in one.xy.as_flattened().iter().enumerate() {
            signed[i] += v;
            absolute[i] += v.abs();
        }
    }
    assert!(relative_error(all.xy.as_flattened(), &signed) < 1e-12);
    assert!(relative_error(all.xy_abs.as_flattened(), &absolute) < 1e-12);
    assert!(relative_error(&absolute, &signed) > 0.1, "the absolute sum says nothing new");
}

#[test]
fn degrees_that_are_not_active_do_nothing() {
    let (p, camera) = scene(31, 3);
    let v_image = random_image(camera.width, camera.height, -1.0, 1.0, 31);
    for active in 0..3 {
        let kept = 3 * (active + 1usize).pow(2);
        let mut truncated = Params { sh_degree: active, ..p.clone() };
        truncated.sh = p.sh.chunks_exact(48).flat_map(|sh| sh[..kept].to_vec()).collect();
        let forward = render(&p, &camera, BACKGROUND, active);
        assert_eq!(forward.image, render(&truncated, &camera, BACKGROUND, active).image);
        let grads = backward(&p, &camera, BACKGROUND, &forward, &v_image);
        let (on, off): (Vec<_>, Vec<_>) =
            grads.sh.chunks_exact(48).map(|sh| (sh[..kept].to_vec(), sh[kept..].to_vec())).unzip();
        assert!(off.concat().iter().all(|v| *v == 0.0));
        assert!(on.concat().iter().any(|v| *v != 0.0));
    }
}

#[test]
fn the_result_does_not_depend_on_threads() {
    let (p, camera) = scene(41, 2);
    let v_image = random_image(camera.width, camera.height, -1.0, 1.0, 41);
    let run = || {
        let forward = render(&p, &camera, BACKGROUND, 2);
        let grads = backward(&p, &camera, BACKGROUND, &forward, &v_image);
        (forward.image, grads.means, grads.sh)
    };
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("thread pool");
    let several = rayon::ThreadPoolBuilder::new().num_threads(3).build().expect("thread pool");
    assert_eq!(alone.install(run), several.install(run));
}
