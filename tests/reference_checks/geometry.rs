//! The geometry and warping twins against the golden data and against finite differences (method.md sections 3 to 5).

use glam::{DMat3, DVec2, DVec3};
use ibgs_core::camera::Camera;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::reference::finite::assert_gradient;
use crate::reference::geometry::{Geometry, Plane, PlaneParams, geometry, median_slots, pixel_ray};
use crate::reference::geometry_backward::{Cotangents, GeometryGrads, geometry_backward};
use crate::reference::golden::{GoldenGradients, load_gradients};
use crate::reference::random_scene::{random_camera, random_image, random_params};
use crate::reference::raster::{Contribution, contributions, tile_pixels};
use crate::reference::warp::{Bilinear, Pair, Source, Warp, warp};
use crate::reference::{Model, Params, relative_error, render_as};

const FILES: [&str; 2] = ["gradients_k4_m3.npz", "gradients_k6_m4.npz"];
/// The outputs of a target view, each a loss of its own, and all together.
const GROUPS: [&str; 6] = ["base", "normal", "depth", "warped", "cosine", "all"];
const TENSORS: [&str; 7] = ["mean", "rotation", "log_scale", "opacity_logit", "sh", "normal", "offset"];

/// A target view with all that it is computed from.
#[derive(Clone)]
struct Scene {
    params: Params,
    planes: PlaneParams,
    camera: Camera,
    background: [f64; 3],
    sources: Vec<Source>,
    k: usize,
    model: Model,
}

impl Scene {
    fn geometry(&self, camera: &Camera) -> Geometry {
        let base = render_as(&self.params, camera, self.background, self.params.sh_degree, self.model);
        geometry(&self.params, &self.planes, camera, base, self.k)
    }

    fn run(&self) -> (Geometry, Warp) {
        let geometry = self.geometry(&self.camera);
        let warp = warp(&self.camera, &geometry, &self.sources);
        (geometry, warp)
    }

    fn grads(&self, geometry: &Geometry, v: &Cotangents) -> GeometryGrads {
        geometry_backward(&self.params, &self.planes, &self.camera, self.background, geometry, &self.sources, v)
    }

    /// Every output, in the shape of its cotangent.
    fn outputs(&self) -> Cotangents {
        let (geometry, warp) = self.run();
        Cotangents {
            base: geometry.base.image,
            normal: geometry.normal,
            depth: geometry.depth,
            warped: warp.warped,
            cosine: warp.feature.iter().map(|f| f[3]).collect(),
        }
    }

    fn tensor(&mut self, name: &str) -> &mut [f64] {
        match name {
            "mean" => self.params.means.as_flattened_mut(),
            "rotation" => self.params.rotations.as_flattened_mut(),
            "log_scale" => self.params.log_scales.as_flattened_mut(),
            "opacity_logit" => &mut self.params.opacity_logits,
            "sh" => &mut self.params.sh,
            "normal" => self.planes.normals.as_flattened_mut(),
            "offset" => &mut self.planes.offsets,
            other => panic!("no tensor {other}"),
        }
    }
}

fn grad<'a>(g: &'a GeometryGrads, name: &str) -> &'a [f64] {
    match name {
        "mean" => g.base.means.as_flattened(),
        "rotation" => g.base.rotations.as_flattened(),
        "log_scale" => g.base.log_scales.as_flattened(),
        "opacity_logit" => &g.base.opacity_logits,
        "sh" => &g.base.sh,
        "normal" => g.normals.as_flattened(),
        "offset" => &g.offsets,
        "xy_pixels" => g.base.xy.as_flattened(),
        "xy_pixels_abs" => g.base.xy_abs.as_flattened(),
        other => panic!("no tensor {other}"),
    }
}

/// The loss whose gradient is `v`, less its value at `start`: a sum of small numbers is rounded less.
fn loss(out: &Cotangents, start: &Cotangents, v: &Cotangents) -> f64 {
    let flat = |c: &Cotangents| {
        let [base, normal, warped] = [&c.base, &c.normal, &c.warped].map(|t| t.as_flattened().to_vec());
        [base, normal, warped, c.depth.clone(), c.cosine.clone()].concat()
    };
    flat(out).iter().zip(flat(start)).zip(flat(v)).map(|((out, start), v)| (out - start) * v).sum()
}

/// `v` with all but one group cleared.
fn only(v: &Cotangents, group: &str) -> Cotangents {
    let pixels = v.depth.len();
    let mut one = Cotangents::zeros(pixels, v.cosine.len() / pixels);
    match group {
        "base" => one.base.clone_from(&v.base),
        "normal" => one.normal.clone_from(&v.normal),
        "depth" => one.depth.clone_from(&v.depth),
        "warped" => one.warped.clone_from(&v.warped),
        "cosine" => one.cosine.clone_from(&v.cosine),
        "all" => one.clone_from(v),
        other => panic!("no output {other}"),
    }
    one
}

/// What does not depend on what: colours only show in the base, planes do not; offsets do not turn normals.
fn independent(group: &str, tensor: &str) -> bool {
    match tensor {
        "sh" => !matches!(group, "base" | "all"),
        "normal" => group == "base",
        "offset" => matches!(group, "base" | "normal"),
        _ => false,
    }
}

fn golden_scene(golden: &GoldenGradients) -> Scene {
    let source = |(i, camera): (usize, &Camera)| Source {
        camera: *camera,
        photo: golden.arrays.get(&format!("source/{i}/photo")).rows().into_iter().map(byte_color).collect(),
        depth: golden.arrays.get(&format!("source/{i}/depth")).data.clone(),
    };
    Scene {
        params: golden.params.clone(),
        planes: PlaneParams { normals: golden.normals.clone(), offsets: golden.offsets.clone() },
        camera: golden.cameras[0],
        background: [0.0; 3],
        sources: golden.cameras[1..].iter().enumerate().map(source).collect(),
        k: golden.k,
        model: Model::Ideal,
    }
}

fn byte_color(c: [f64; 3]) -> [f64; 3] {
    c.map(|v| v / 255.0)
}

fn golden_cotangents(golden: &GoldenGradients) -> Cotangents {
    let get = |name: &str| golden.arrays.get(&format!("cotangent/{name}"));
    Cotangents {
        base: get("base").rows(),
        normal: get("normal").rows(),
        depth: get("depth").data.clone(),
        warped: get("warped").rows(),
        cosine: get("cosine").data.clone(),
    }
}

#[test]
fn outputs_agree_with_the_golden_data() {
    for file in FILES {
        let Some(golden) = load_gradients(file) else {
            return;
        };
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
        let slot: Vec<f64> = warp.slot.iter().map(|s| f64::from(*s)).collect();
        assert_eq!(slot, golden.arrays.get("out/slot").data, "{file} out/slot");
        assert!(slot.contains(&-1.0) && slot.contains(&1.0), "{file}: too plain");
        assert!(geometry.slots.iter().any(|s| s.len() == golden.k), "{file}: no pixel fills its slots");
    }
}

#[test]
fn gradients_agree_with_automatic_differentiation() {
    for file in FILES {
        let Some(golden) = load_gradients(file) else {
            return;
        };
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

fn uniform3(rng: &mut ChaCha8Rng, size: f64) -> DVec3 {
    DVec3::from_array(std::array::from_fn(|_| rng.random_range(-size..size)))
}

/// A camera beside `camera`: its own size and intrinsics, moved by `step` in the view space and turned a little.
fn beside(camera: &Camera, step: DVec3, turn: f64) -> Camera {
    let view_from_world = DMat3::from_rotation_y(turn) * DMat3::from_rotation_x(-0.5 * turn) * camera.view_from_world;
    let center = camera.center() + camera.view_from_world.transpose() * step;
    let mut moved = camera.resized(camera.width + 4, camera.height + 3);
    moved.focal *= DVec2::new(0.9, 0.95);
    Camera { view_from_world, translation: -(view_from_world * center), ..moved }
}

/// Smooth, so that a finite difference seldom meets the kink between two cells of texels.
fn smooth_photo(camera: &Camera, seed: u64) -> Vec<[f64; 3]> {
    let wave = |x: u32, y: u32, c: usize| {
        let (x, y, shift) = (f64::from(x), f64::from(y), seed as f64 + c as f64);
        0.5 + 0.25 * (0.21 * x + shift).sin() + 0.25 * (0.17 * y - 2.0 * shift).cos()
    };
    (0..camera.height).flat_map(|y| (0..camera.width).map(move |x| [0, 1, 2].map(|c| wave(x, y, c)))).collect()
}

/// A bumpy wall 4 units in front of the camera whose normals face either way, seen by three sources. The first
/// Gaussian's plane is moved behind the camera centre, where D - n_c . t is negative; the second's is nearly edge-on.
fn wall(seed: u64, k: usize) -> Scene {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let camera = random_camera(33, 25, seed);
    let world_from_view = camera.view_from_world.transpose();
    let mut params = random_params(14, 1, seed);
    let mut planes = PlaneParams::default();
    for i in 0..params.len() {
        let view = uniform3(&mut rng, 1.0) * DVec3::new(1.0, 0.8, 0.06) + DVec3::Z * 4.0;
        params.means[i] = (camera.center() + world_from_view * view).to_array();
        params.log_scales[i] = params.log_scales[i].map(|s| 0.5 * s + 0.1);
        let facing = if i % 2 == 0 { -1.0 } else { 1.0 };
        let normal = facing * DVec3::Z * rng.random_range(0.5..2.0) + uniform3(&mut rng, 0.08);
        planes.normals.push((world_from_view * normal).to_array());
        planes.offsets.push(rng.random_range(-0.02..0.02));
    }
    planes.offsets[0] = -8.0;
    planes.normals[1] = (world_from_view * DVec3::new(1.0, 0.3, 0.05)).to_array();
    let background = [0.3, 0.7, 0.1];
    let mut scene = Scene { params, planes, camera, background, sources: Vec::new(), k, model: Model::Tiled };
    let steps = [DVec3::new(0.3, 0.1, -0.1), DVec3::new(-0.9, 0.2, 0.2), DVec3::new(0.1, -0.4, 0.3)];
    for (i, step) in steps.into_iter().enumerate() {
        let camera = beside(&scene.camera, step, 0.05 * (i as f64 - 1.0));
        let depth = scene.geometry(&camera).depth;
        scene.sources.push(Source { camera, photo: smooth_photo(&camera, seed + i as u64), depth });
    }
    scene
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
        self.unseen |= warp.slot[..pixels].contains(&-1);
        self.seen_by_all |= warp.slot[2 * pixels..].contains(&2);
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
                let mut seen = pairs.iter().filter_map(|p| p.see(ray, &geometry.slots[i], geometry.depth[i]));
                self.partly_inside |= seen.any(|s| s.landings.len() < geometry.slots[i].len());
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
    let kept = |k| median_slots(&parts, &planes, DVec3::Z, k).iter().map(|s| s.gaussian).collect::<Vec<_>>();
    assert_eq!(kept(2), [4, 5]);
    assert_eq!(kept(4), [2, 4, 5, 6]);
    assert_eq!(kept(8), [0, 1, 2, 4, 5, 6, 7, 8]);
    let slot = median_slots(&parts, &planes, DVec3::Z, 2)[1];
    assert!((slot.depth - 6.0).abs() < 1e-6 && slot.weight == 0.05 && slot.transmittance == 0.5 && slot.entry == 10);
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
