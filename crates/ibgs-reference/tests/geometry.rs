//! The geometry and warping twins against the golden data and against finite differences (method.md sections 3 to 5).

use glam::{DVec2, DVec3};

use ibgs_reference::finite::assert_gradient;
use ibgs_reference::geometry::{Geometry, Plane, median_intersections, pixel_ray};
use ibgs_reference::geometry_backward::Cotangents;
use ibgs_reference::golden::load_gradients;
use ibgs_reference::random_scene::{random_camera, random_image};
use ibgs_reference::raster::{Contribution, contributions, tile_pixels};
use ibgs_reference::relative_error;
use ibgs_reference::surface_scene::*;
use ibgs_reference::warp::{Bilinear, Pair, Warp};

/// The loss whose gradient is `v`, less its value at `start`: a sum of small numbers is rounded less.
pub(crate) fn loss(out: &Cotangents, start: &Cotangents, v: &Cotangents) -> f64 {
    let flat = |c: &Cotangents| {
        let [base, normal, warped] = [&c.base, &c.normal, &c.warped].map(|t| t.as_flattened().to_vec());
        [base, normal, warped, c.depth.clone(), c.cosine.clone()].concat()
    };
    flat(out).iter().zip(flat(start)).zip(flat(v)).map(|((out, start), v)| (out - start) * v).sum()
}

#[test]
fn outputs_agree_with_the_golden_data() {
    for file in FILES {
        let golden = load_gradients(file);
        let (geometry, warp) = golden_scene(&golden).run();
        let checks = [
            ("base", geometry.base.image.as_flattened()),
            ("normal", geometry.normal.as_flattened()),
            ("depth", &geometry.depth[..]),
            ("warped", warp.warped.as_flattened()),
            ("feat", warp.feature.as_flattened()),
        ];
        for (name, ours) in checks {
            let truth = &golden.arrays.get(&format!("out/{name}")).data;
            assert!(truth.iter().any(|v| *v != 0.0), "{file} out/{name}: nothing to compare");
            let error = relative_error(ours, truth);
            println!("{file} out/{name}: {error:.1e}");
            assert!(error < 1e-9, "{file} out/{name}: relative error {error:e}");
        }
        let source: Vec<f64> = warp.source.iter().map(|s| f64::from(*s)).collect();
        assert_eq!(source, golden.arrays.get("out/slot").data, "{file} out/slot");
        assert!(source.contains(&-1.0) && source.contains(&1.0), "{file}: too plain");
        assert!(
            geometry.intersections.iter().any(|s| s.len() == golden.k),
            "{file}: no pixel has all its intersections"
        );
    }
}

#[test]
fn gradients_agree_with_automatic_differentiation() {
    for file in FILES {
        let golden = load_gradients(file);
        let (scene, v) = (golden_scene(&golden), golden_cotangents(&golden));
        let (geometry, _) = scene.run();
        for group in GROUPS {
            let grads = scene.grads(&geometry, &only(&v, group));
            let mut worst: f64 = 0.0;
            for name in TENSORS.into_iter().chain(["xy_pixels", "xy_pixels_abs"]) {
                let (ours, truth) = (grad(&grads, name), golden.grad(group, name));
                if truth.iter().all(|v| *v == 0.0) {
                    assert!(independent(group, name), "{file} {group}/{name}: nothing to compare");
                    assert!(ours.iter().all(|v| *v == 0.0), "{file} {group}/{name}: should be zero");
                    continue;
                }
                assert!(ours.iter().any(|v| *v != 0.0), "{file} {group}/{name}: zero everywhere");
                let error = relative_error(ours, truth);
                worst = worst.max(error);
                assert!(error < 1e-9, "{file} grad/{group}/{name}: relative error {error:e}");
            }
            println!("{file} grad/{group}: worst tensor {worst:.1e}");
        }
    }
}

/// What the walls must exercise, so that no branch goes untested.
#[derive(Debug, Default)]
struct Coverage {
    turned_normal: bool,
    negative_distance: bool,
    behind_camera: bool,
    before_overflows: bool,
    after_overflows: bool,
    seen_by_all: bool,
    unseen: bool,
    partly_inside: bool,
}

impl Coverage {
    fn observe(&mut self, scene: &Scene, geometry: &Geometry, warp: &Warp) {
        let Scene { camera, k, .. } = scene;
        self.turned_normal |= geometry.planes.iter().any(|p| p.flip < 0.0);
        self.negative_distance |= geometry.planes.iter().any(|p| p.sign < 0.0);
        let pixels = geometry.depth.len();
        self.unseen |= warp.source[..pixels].contains(&-1);
        self.seen_by_all |= warp.source[2 * pixels..].contains(&2);
        let pairs: Vec<Pair> = scene.sources.iter().map(|s| Pair::new(camera, s)).collect();
        for (tile, list) in geometry.base.order.iter().enumerate() {
            for (x, y) in tile_pixels(camera, tile) {
                let ray = pixel_ray(camera, x, y);
                let i = (y * camera.width + x) as usize;
                let (parts, _) = contributions(&geometry.base.projected, list, x, y);
                let hit = |c: &&Contribution| geometry.planes[c.gaussian].depth(ray).is_some();
                self.behind_camera |= !parts.iter().all(|c| hit(&c));
                let before = parts.iter().filter(hit).filter(|c| c.transmittance > 0.5).count();
                let after = parts.iter().filter(hit).count() - before;
                self.before_overflows |= before > k / 2;
                self.after_overflows |= after > k / 2;
                let mut seen = pairs.iter().filter_map(|p| p.see(ray, &geometry.intersections[i], geometry.depth[i]));
                self.partly_inside |= seen.any(|s| s.landings.len() < geometry.intersections[i].len());
            }
        }
    }

    fn complete(&self) -> bool {
        let seen = self.seen_by_all && self.unseen && self.partly_inside;
        let planes = self.turned_normal && self.negative_distance && self.behind_camera;
        planes && self.before_overflows && self.after_overflows && seen
    }
}

#[test]
fn every_gradient_agrees_with_finite_differences() {
    let mut coverage = Coverage::default();
    for (seed, k) in [(1, 4), (2, 2)] {
        let scene = wall(seed, k);
        let (geometry, warp) = scene.run();
        let start = scene.outputs();
        coverage.observe(&scene, &geometry, &warp);
        let image = |salt: u64| random_image(scene.camera.width, scene.camera.height, -1.0, 1.0, 10 * seed + salt);
        let scalars = |salt: u64| image(salt).into_iter().map(|v| v[0]);
        let v = Cotangents {
            base: image(0),
            normal: image(1),
            depth: scalars(2).collect(),
            warped: (3..6).flat_map(image).collect(),
            cosine: (6..9).flat_map(scalars).collect(),
        };
        for group in GROUPS {
            let v = only(&v, group);
            let grads = scene.grads(&geometry, &v);
            // The cosine hardly feels the weights: such a difference is mostly rounding.
            let tolerance = if group == "cosine" { 1e-4 } else { 1e-5 };
            for name in TENSORS {
                let ours = grad(&grads, name);
                if independent(group, name) {
                    assert!(ours.iter().all(|v| *v == 0.0), "{group}/{name}: should be zero");
                    continue;
                }
                let moved_loss = |values: &[f64]| {
                    let mut moved = scene.clone();
                    moved.tensor(name).copy_from_slice(values);
                    loss(&moved.outputs(), &start, &v)
                };
                let at = scene.clone().tensor(name).to_vec();
                let label = format!("seed {seed} {group}/{name}");
                let worst = assert_gradient(&label, &at, ours, tolerance, moved_loss);
                println!("{label}: worst relative error {worst:.1e}");
            }
        }
    }
    assert!(coverage.complete(), "the scenes leave a branch untested: {coverage:?}");
}

fn part(gaussian: usize, alpha: f64, transmittance: f64) -> Contribution {
    Contribution { entry: 2 * gaussian, gaussian, alpha, transmittance, falloff: 1.0, offset: [0.0; 2] }
}

#[test]
fn the_median_buffers_straddle_one_half() {
    let plane = |z: f64| Plane { normal: DVec3::NEG_Z, distance: z, ..Plane::default() };
    let mut planes: Vec<Plane> = (1..10).map(|z| plane(f64::from(z))).collect();
    // A plane that faces away is never met.
    planes[3].normal = DVec3::Z;
    let transmittances = [1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2];
    let parts: Vec<_> = transmittances.iter().enumerate().map(|(i, t)| part(i, 0.1, *t)).collect();
    let kept = |k| median_intersections(&parts, &planes, DVec3::Z, k).iter().map(|s| s.gaussian).collect::<Vec<_>>();
    assert_eq!(kept(2), [4, 5]);
    assert_eq!(kept(4), [2, 4, 5, 6]);
    assert_eq!(kept(8), [0, 1, 2, 4, 5, 6, 7, 8]);
    let met = median_intersections(&parts, &planes, DVec3::Z, 2)[1];
    assert!((met.depth - 6.0).abs() < 1e-6 && met.weight == 0.05 && met.transmittance == 0.5 && met.entry == 10);
}

#[test]
fn a_plane_faces_the_camera_and_holds_its_depth() {
    let camera = random_camera(20, 16, 5);
    let ray = pixel_ray(&camera, 3, 12);
    // A mean where the ray is 4 deep, its plane square to the view and moved 0.5 against its normal.
    let world_from_view = camera.view_from_world.transpose();
    let mean = camera.center() + world_from_view * (4.0 * ray);
    let towards = Plane::new(mean, world_from_view * DVec3::NEG_Z * 3.0, 0.5, &camera);
    let away = Plane::new(mean, world_from_view * DVec3::Z * 3.0, -0.5, &camera);
    for plane in [towards, away] {
        assert!(plane.normal.distance(DVec3::NEG_Z) < 1e-6);
        let depth = plane.depth(ray).expect("the ray meets the plane");
        assert!((depth - 4.5).abs() < 1e-5, "{depth}");
    }
    assert_eq!(Plane::new(mean, DVec3::ZERO, 0.5, &camera), Plane::default());
    assert_eq!(Plane::new(mean, DVec3::X, f64::NAN, &camera), Plane::default());
    assert_eq!(Plane::default().depth(ray), None);
}

#[test]
fn a_read_needs_four_texels() {
    let image: Vec<[f64; 1]> = [1.0, 2.0, 4.0, 3.0, 5.0, 9.0].map(|v| [v]).to_vec();
    let read = |u: f64, v: f64| Bilinear::new(DVec2::new(u, v), 3, 2).map(|b| b.read(&image)[0]);
    assert_eq!((read(0.5, 0.5), read(2.5, 1.5), read(1.0, 1.0)), (Some(1.0), Some(9.0), Some(2.75)));
    assert_eq!((read(0.499, 1.0), read(2.501, 1.0), read(1.0, 0.499), read(1.0, 1.501)), (None, None, None, None));
    assert_eq!((read(f64::NAN, 1.0), Bilinear::new(DVec2::splat(0.5), 1, 1)), (None, None));
    let slope = Bilinear::new(DVec2::new(2.25, 0.75), 3, 2).expect("inside").slope(&image);
    assert_eq!(slope, [[2.5], [4.5]]);
}
