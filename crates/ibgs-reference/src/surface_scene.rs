//! Target views with their sources, for the twins' own tests and the kernels': the golden scenes and a random wall.

use glam::{DMat3, DVec2, DVec3};
use ibgs_data::camera::Camera;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::geometry::{Geometry, PlaneParams, geometry};
use super::geometry_backward::{Cotangents, GeometryGrads, geometry_backward};
use super::golden::GoldenGradients;
use super::random_scene::{random_camera, random_params};
use super::warp::{Source, Warp, warp};
use super::{Model, Params, Tensor, render_as};

pub const FILES: [&str; 3] = ["gradients_k2_m2.npz", "gradients_k4_m3.npz", "gradients_k6_m4.npz"];
/// The outputs of a target view, each a loss of its own, and all together.
pub const GROUPS: [&str; 6] = ["base", "normal", "depth", "warped", "cosine", "all"];
/// Names of the parameters in the golden data, in the order of [`PerGaussian`](ibgs_data::scene::PerGaussian).
pub const TENSORS: [&str; 7] = ["mean", "rotation", "log_scale", "opacity_logit", "sh", "normal", "offset"];

/// A target view with all that it is computed from.
#[derive(Clone)]
pub struct Scene {
    pub params: Params,
    pub planes: PlaneParams,
    pub camera: Camera,
    pub background: [f64; 3],
    pub sources: Vec<Source>,
    pub k: usize,
    pub model: Model,
}

impl Scene {
    pub fn geometry(&self, camera: &Camera) -> Geometry {
        let base = render_as(&self.params, camera, self.background, self.params.sh_degree, self.model);
        geometry(&self.params, &self.planes, camera, base, self.k)
    }

    pub fn run(&self) -> (Geometry, Warp) {
        let geometry = self.geometry(&self.camera);
        let warp = warp(&self.camera, &geometry, &self.sources);
        (geometry, warp)
    }

    pub fn grads(&self, geometry: &Geometry, v: &Cotangents) -> GeometryGrads {
        geometry_backward(&self.params, &self.planes, &self.camera, self.background, geometry, &self.sources, v)
    }

    /// Every output, in the shape of its cotangent.
    pub fn outputs(&self) -> Cotangents {
        let (geometry, warp) = self.run();
        Cotangents {
            base: geometry.base.image,
            normal: geometry.normal,
            depth: geometry.depth,
            warped: warp.warped,
            cosine: warp.feature.iter().map(|f| f[3]).collect(),
        }
    }

    pub fn tensor(&mut self, name: &str) -> &mut [f64] {
        if let Some(tensor) = Tensor::named(name) {
            return self.params.get_mut(tensor);
        }
        match name {
            "normal" => self.planes.normals.as_flattened_mut(),
            "offset" => &mut self.planes.offsets,
            other => panic!("no tensor {other}"),
        }
    }
}

pub fn grad<'a>(g: &'a GeometryGrads, name: &str) -> &'a [f64] {
    if let Some(tensor) = Tensor::named(name) {
        return g.base.get(tensor);
    }
    match name {
        "normal" => g.normals.as_flattened(),
        "offset" => &g.offsets,
        "xy_pixels" => g.base.xy.as_flattened(),
        "xy_pixels_abs" => g.base.xy_abs.as_flattened(),
        other => panic!("no tensor {other}"),
    }
}

/// `v` with all but one group cleared.
pub fn only(v: &Cotangents, group: &str) -> Cotangents {
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
pub fn independent(group: &str, tensor: &str) -> bool {
    match tensor {
        "sh" => !matches!(group, "base" | "all"),
        "normal" => group == "base",
        "offset" => matches!(group, "base" | "normal"),
        _ => false,
    }
}

pub fn golden_scene(golden: &GoldenGradients) -> Scene {
    let source = |(i, camera): (usize, &Camera)| Source {
        camera: *camera,
        photo: golden.arrays.get(&format!("source/{i}/photo")).rows().into_iter().map(byte_color).collect(),
        valid: vec![true; (camera.width * camera.height) as usize],
        depth: golden.arrays.get(&format!("source/{i}/depth")).data.clone(),
        reach: 1.0,
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

pub fn byte_color(c: [f64; 3]) -> [f64; 3] {
    c.map(|v| v / 255.0)
}

pub fn golden_cotangents(golden: &GoldenGradients) -> Cotangents {
    let get = |name: &str| golden.arrays.get(&format!("cotangent/{name}"));
    Cotangents {
        base: get("base").rows(),
        normal: get("normal").rows(),
        depth: get("depth").data.clone(),
        warped: get("warped").rows(),
        cosine: get("cosine").data.clone(),
    }
}

pub fn uniform3(rng: &mut ChaCha8Rng, size: f64) -> DVec3 {
    DVec3::from_array(std::array::from_fn(|_| rng.random_range(-size..size)))
}

/// A camera beside `camera`: its own size and intrinsics, moved by `step` in the view space and turned a little.
pub fn beside(camera: &Camera, step: DVec3, turn: f64) -> Camera {
    let view_from_world = DMat3::from_rotation_y(turn) * DMat3::from_rotation_x(-0.5 * turn) * camera.view_from_world;
    let center = camera.center() + camera.view_from_world.transpose() * step;
    let mut moved = camera.resized(camera.width + 4, camera.height + 3);
    moved.focal *= DVec2::new(0.9, 0.95);
    Camera { view_from_world, translation: -(view_from_world * center), ..moved }
}

/// Smooth, so that a finite difference seldom meets the kink between two cells of texels.
pub fn smooth_photo(camera: &Camera, seed: u64) -> Vec<[f64; 3]> {
    let wave = |x: u32, y: u32, c: usize| {
        let (x, y, shift) = (f64::from(x), f64::from(y), seed as f64 + c as f64);
        0.5 + 0.25 * (0.21 * x + shift).sin() + 0.25 * (0.17 * y - 2.0 * shift).cos()
    };
    (0..camera.height).flat_map(|y| (0..camera.width).map(move |x| [0, 1, 2].map(|c| wave(x, y, c)))).collect()
}

/// A bumpy wall 4 units in front of the camera whose normals face either way, seen by three sources. The first
/// Gaussian's plane is moved behind the camera centre, where D - n_c . t is negative; the second's is nearly edge-on.
pub fn wall(seed: u64, k: usize) -> Scene {
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
    let mut scene = Scene { params, planes, camera, background, sources: Vec::new(), k, model: Model::Outline };
    let steps = [DVec3::new(0.3, 0.1, -0.1), DVec3::new(-0.9, 0.2, 0.2), DVec3::new(0.1, -0.4, 0.3)];
    for (i, step) in steps.into_iter().enumerate() {
        let camera = beside(&scene.camera, step, 0.05 * (i as f64 - 1.0));
        let depth = scene.geometry(&camera).depth;
        let (photo, valid) = (smooth_photo(&camera, seed + i as u64), vec![true; depth.len()]);
        scene.sources.push(Source { camera, photo, valid, depth, reach: 1.0 });
    }
    scene
}
