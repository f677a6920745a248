//! The loss of the last stage as a trainer combines it, on the GPU, against its double-precision twin.

use super::surface::warping;
use crate::common::{by_parameters, scene_parameters, values};
use burn::tensor::{Tensor, TensorData};
use ibgs_core::dataset::Photo;
use ibgs_core::exposure::ExposurePass;
use ibgs_core::raster::Keep;
use ibgs_core::residual::layers::{LAYERS, WEIGHTS};
use ibgs_core::residual::{Aggregation, Factor, Output, Precision, Residual, ResidualInputs, ResidualTask, Variant};
use ibgs_core::sources::DevicePhoto;
use ibgs_core::sources::Warper;
use ibgs_reference::exposure::Exposure;
use ibgs_reference::gpu::view_of;
use ibgs_reference::gpu::{gpu, pixels, rasterizer, scene_splats, source_view};
use ibgs_reference::random_scene::{exact, random_image};
use ibgs_reference::surface_scene::{Scene, TENSORS, smooth_photo, wall};
use ibgs_reference::warp::SOFT_REACH;
use ibgs_reference::whole_loss::{Case, CaseGrads, LAMBDA, Losses, NAMES, NORMAL, PHOTO};
use ibgs_shaders::EXPOSURE_PULL;
use ibgs_train::autodiff::{self, Leaves};
use ibgs_train::loss::{ImageLoss, NormalLoss, PhotometricLoss, SurfaceBuffers};
use ibgs_train::tensor::device;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const DIRECTIONS: u64 = 20;

fn bytes(map: &mut [[f64; 3]]) {
    map.as_flattened_mut().iter_mut().for_each(|v| *v = (*v * 255.0).round() / 255.0);
}

/// Uniform in +-1/sqrt(fan in), as a fresh network.
fn network(seed: u64) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut weights = Vec::with_capacity(WEIGHTS);
    for layer in LAYERS {
        let bound = 1.0 / ((layer.inputs * layer.taps) as f64).sqrt();
        weights.extend((layer.offset..layer.end()).map(|_| exact(rng.random_range(-bound..bound))));
    }
    weights
}

/// A wall without its nearly edge-on plane, whose gradient would drown those of the other normals.
fn case(seed: u64, exposed: bool, factor: Factor) -> Case {
    let mut scene = wall(seed, 4);
    scene.planes.normals[1] = scene.planes.normals[3];
    scene.sources.iter_mut().for_each(|source| bytes(&mut source.photo));
    for name in TENSORS {
        scene.tensor(name).iter_mut().for_each(|v| *v = exact(*v));
    }
    let mut photo = smooth_photo(&scene.camera, seed + 7);
    bytes(&mut photo);
    let variant = Variant { factor, ..Variant::default() };
    let number = |range: f64, seed: u64| random_image(1, 1, -range, range, seed)[0].map(exact);
    let exposures = (0..=scene.sources.len() as u64)
        .filter(|_| exposed)
        .map(|i| Exposure { log_gain: number(0.3, 80 + 2 * i), offset: number(0.05, 81 + 2 * i) })
        .collect();
    Case { scene, photo, weights: network(seed), variant, exposures, gain: 1.0, detached: false }
}

fn target(scene: &Scene, photo: &[[f64; 3]]) -> DevicePhoto {
    let texel = |c: &[f64; 3]| [c[0], c[1], c[2], 1.0].map(|v| (v * 255.0).round() as u8);
    let (width, height) = (scene.camera.width, scene.camera.height);
    let rgba = photo.iter().flat_map(texel).collect();
    DevicePhoto::upload(&gpu(), &Photo { width, height, rgba }).unwrap()
}

struct OnGpu {
    /// `last` is zero where the final image is left out.
    losses: Losses,
    total: f64,
    grads: Vec<(&'static str, Vec<f64>)>,
    /// By the photo's exposure.
    exposure: Option<Vec<f64>>,
}

impl OnGpu {
    fn get(&self, name: &str) -> &[f64] {
        &self.grads.iter().find(|(n, _)| *n == name).unwrap_or_else(|| panic!("no gradient by {name}")).1
    }
}

/// What the gradients are taken of.
#[derive(Clone, Copy, PartialEq)]
enum Part {
    All,
    /// L_img(final)/2 alone.
    Last,
    /// All but that; the network does not run.
    Side,
}

/// One iteration.
fn on_gpu(case: &Case, part: Part) -> OnGpu {
    let (gpu, raster, scene) = (gpu(), rasterizer(), &case.scene);
    let (view, model, photo) = (view_of(scene, 0.5), scene_parameters(scene), target(scene, &case.photo));
    // Makes room for every intersection.
    raster.render(model.splats(), &view).unwrap();
    let sources: Vec<_> = scene.sources.iter().map(source_view).collect();
    let leaves = Leaves::new(&model);
    let flat: Vec<f32> = case.weights.iter().map(|w| *w as f32).collect();
    let weights =
        Tensor::<1>::from_data(TensorData::new(flat, [WEIGHTS]), device(&gpu).unwrap()).autodiff().require_grad();
    let (base, forward) = autodiff::rasterized(&raster, &leaves, &view, None, None).unwrap();
    let warper = Warper::new(gpu.clone(), warping(scene));
    let (warped, pass) = autodiff::warped(&warper, &base, &forward, &sources).unwrap();
    let seen = &pass.seen;
    let exposure_pass = ExposurePass::new(gpu.clone());
    let numbers: Vec<_> = case.exposures.iter().map(Exposure::single).collect();
    let exposures = numbers.split_first().map(|(own, sources)| exposure_pass.upload(own, sources).unwrap());
    let (plain, base) =
        (base.clone(), exposures.as_ref().map_or(base.clone(), |e| autodiff::exposed(e, &base, &forward).unwrap()));
    let warped = exposures.as_ref().map_or(warped.clone(), |e| autodiff::exposed_warped(e, warped, &pass).unwrap());
    let image_loss = ImageLoss::new(gpu.clone(), LAMBDA as f32);
    let surface = SurfaceBuffers::of(forward.surface().unwrap());
    let l_base = image_loss.tracked(base.clone(), &photo).unwrap().0;
    let l_normal = NormalLoss::new(gpu.clone(), NORMAL as f32).tracked(&plain, &surface, &photo).unwrap();
    let l_photo =
        PhotometricLoss::new(gpu.clone(), PHOTO as f32).tracked(warped.clone(), &seen.visible, &photo).unwrap();
    let residual = Residual::new(gpu.clone(), case.variant, Precision::Full);
    let l_last = (part != Part::Side).then(|| {
        let (base, warped) = if case.detached { (base.detach(), warped.detach()) } else { (base, warped) };
        let task = ResidualTask { camera: scene.camera, seen: seen.clone(), gain: case.gain as f32 };
        let image = autodiff::residual(&residual, &task, base, warped, weights.clone()).unwrap();
        image_loss.tracked(image, &photo).unwrap().0
    });
    let side = l_base.clone() * 0.5 + l_normal.clone() + l_photo.clone();
    let total = match l_last.clone().map(|l| l * 0.5) {
        None => side,
        Some(last) if part == Part::Last => last,
        Some(last) => side + last,
    };
    let value = |loss: Tensor<1>| values(loss.inner())[0];
    let losses =
        Losses { base: value(l_base), last: l_last.map_or(0.0, value), normal: value(l_normal), photo: value(l_photo) };
    let mut grads = total.clone().backward();
    let by_weights = weights.grad_remove(&mut grads).map(values);
    assert_eq!(by_weights.is_some(), part != Part::Side, "only the final image reaches the network");
    let g = leaves.gradients(&mut grads).expect("the image reaches the loss");
    let tensors =
        by_parameters(g, &scene.params, &view).map(|gradient| gradient.expect("a surface has plane gradients"));
    let grads = TENSORS.into_iter().zip(tensors.into_array()).chain(by_weights.map(|w| ("network", w))).collect();
    let exposure = exposures.map(|e| {
        let row = gpu.read(e.v_target(), 2).unwrap().into_flattened();
        let own = case.exposures[0].numbers().map(|v| f64::from(EXPOSURE_PULL) * v);
        [0, 1, 2, 4, 5, 6].into_iter().zip(own).map(|(i, pull): (usize, f64)| f64::from(row[i]) - pull).collect()
    });
    OnGpu { losses, total: value(total), grads, exposure }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// One random direction over some tensors, each tensor's part scaled by 1/|g|, so that none drowns the others.
struct Direction(Vec<(&'static str, Vec<f64>)>);

impl Direction {
    fn new(names: &[&'static str], truth: &CaseGrads, seed: u64) -> Direction {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let part = |name: &&'static str| {
            let g = truth.get(name);
            let d: Vec<f64> = g.iter().map(|_| rng.random_range(-1.0..1.0)).collect();
            let scale = 1.0 / (dot(g, g) * dot(&d, &d)).sqrt();
            (*name, d.into_iter().map(|x| scale * x).collect())
        };
        Direction(names.iter().map(part).collect())
    }

    fn along<'a>(&self, gradient: impl Fn(&'static str) -> &'a [f64]) -> f64 {
        self.0.iter().map(|(name, d)| dot(gradient(name), d)).sum()
    }

    /// Root mean square of g . d over such directions: sqrt(sum over tensors of |g|^2 |d|^2 / entries).
    fn scale(&self) -> f64 {
        self.0.iter().map(|(_, d)| 1.0 / d.len() as f64).sum::<f64>().sqrt()
    }
}

/// Largest error of g . d over the directions, relative to its root mean square.
fn worst_direction(names: &[&'static str], ours: &OnGpu, truth: &CaseGrads) -> f64 {
    let error = |seed| {
        let d = Direction::new(names, truth, seed);
        (d.along(|name| ours.get(name)) - d.along(|name| truth.get(name))).abs() / d.scale()
    };
    (0..DIRECTIONS).map(error).fold(0.0, f64::max)
}

fn assert_losses(what: &str, ours: &OnGpu, truth: &Losses) {
    let pairs = [
        ("total", ours.total, truth.total()),
        ("base", ours.losses.base, truth.base),
        ("final", ours.losses.last, truth.last),
        ("normal", ours.losses.normal, truth.normal),
        ("photo", ours.losses.photo, truth.photo),
    ];
    for (name, ours, truth) in pairs {
        let error = (ours - truth).abs() / truth;
        println!("{what}: loss {name} {truth:.6}, relative error {error:.1e}");
        assert!(truth > 0.0 && error <= 1e-5, "{what}: {name} is {ours} where {truth} is true");
    }
}

fn assert_follows_twin(what: &str, case: &Case) {
    let run = case.run();
    let truth = case.backward(&run);
    let ours = on_gpu(case, Part::All);
    if let Some(exposure) = &ours.exposure {
        super::assert_gradient(&format!("{what} exposure"), exposure, &truth.exposure, 1e-3);
    }
    assert_losses(what, &ours, &run.losses);
    for name in NAMES {
        super::assert_gradient(&format!("{what} {name}"), ours.get(name), truth.get(name), 1e-3);
    }
    for (which, names) in [("all parameters", &NAMES[..]), ("the network", &NAMES[7..])] {
        let error = worst_direction(names, &ours, &truth);
        println!("{what}: {DIRECTIONS} directions over {which}: {error:.1e}");
        assert!(error <= 1e-3, "{what}: directional derivative over {which}: {error:e}");
    }
    if !case.detached {
        assert_final_image_follows_twin(what, case);
    }
}

/// What the final image alone teaches the Gaussians: in the sum of all losses the others could hide an error of it.
fn assert_final_image_follows_twin(what: &str, case: &Case) {
    let run = case.run();
    let (all, cut) = (case.backward(&run), Case { detached: true, ..case.clone() }.backward(&run));
    let ours = on_gpu(case, Part::Last);
    for name in TENSORS {
        let truth: Vec<f64> = all.get(name).iter().zip(cut.get(name)).map(|(a, b)| a - b).collect();
        super::assert_gradient(&format!("{what}, final image alone, {name}"), ours.get(name), &truth, 1e-3);
    }
}

#[test]
fn the_whole_loss_follows_the_twin() {
    for seed in [1, 2] {
        assert_follows_twin(&format!("wall {seed}"), &case(seed, false, Factor::Full));
    }
}

#[test]
fn the_whole_loss_with_exposures_follows_the_twin() {
    assert_follows_twin("exposure", &case(3, true, Factor::Full));
}

#[test]
fn the_whole_loss_at_half_the_size_follows_the_twin() {
    assert_follows_twin("half size", &case(4, false, Factor::Half));
    assert_follows_twin("half size, exposure", &case(1, true, Factor::Half));
}

#[test]
fn the_whole_loss_with_confidences_follows_the_twin() {
    for (seed, exposed, factor) in [(1, false, Factor::Full), (3, true, Factor::Half)] {
        let mut case = case(seed, exposed, factor);
        case.variant.aggregation = Aggregation::Soft;
        // Half of every source's depths beyond what agrees.
        for source in &mut case.scene.sources {
            source.reach = SOFT_REACH;
            let beyond = |(i, z): (usize, &mut f64)| *z = exact(*z * (1.0 + 0.024 * (i % 2) as f64));
            source.depth.iter_mut().enumerate().for_each(beyond);
        }
        assert_follows_twin(&format!("confidences {seed}"), &case);
    }
}

#[test]
fn the_whole_loss_with_a_gated_output_follows_the_twin() {
    for (seed, exposed, factor) in [(1, false, Factor::Full), (3, true, Factor::Half)] {
        let mut case = case(seed, exposed, factor);
        case.variant.output = Output::Gated;
        assert_follows_twin(&format!("gated {seed}"), &case);
    }
}

/// Burn-in: the Gaussians do not see the final image at all, the network learns as ever.
#[test]
fn during_burn_in_the_final_image_teaches_the_network_alone() {
    let case = Case { detached: true, gain: exact(0.7), ..case(1, false, Factor::Full) };
    assert_follows_twin("burn-in", &case);
    let (with, without) = (on_gpu(&case, Part::All), on_gpu(&case, Part::Side));
    for name in TENSORS {
        assert!(with.get(name) == without.get(name), "{name}: not the gradient of the loss without the final image");
    }
    let last = on_gpu(&Case { detached: false, ..case }, Part::Last);
    assert!(last.get("network") == with.get("network"), "the network learns the same from the same picture");
}

/// Central differences of the twin's loss; of several steps the best counts: a small one keeps away from the thresholds
/// of blending and visibility, a large one from rounding.
#[test]
fn the_twin_follows_finite_differences() {
    for (what, case) in [("plain", case(1, false, Factor::Full)), ("exposure, half", case(3, true, Factor::Half))] {
        let mut case = case;
        // Where no offset counts and the background is black, what shines through has no say.
        case.exposures.iter_mut().for_each(|e| e.offset = [0.0; 3]);
        if !case.exposures.is_empty() {
            case.scene.background = [0.0; 3];
        }
        let truth = case.backward(&case.run());
        for (seed, names) in (50..).zip([&NAMES[..], &NAMES[..], &NAMES[..7], &NAMES[5..7], &NAMES[7..]]) {
            let d = Direction::new(names, &truth, seed);
            let moved = |step: f64| {
                let mut case = case.clone();
                for (name, d) in &d.0 {
                    case.tensor(name).iter_mut().zip(d).for_each(|(x, d)| *x += step * d);
                }
                case.run().losses.total()
            };
            let analytic = d.along(|name| truth.get(name));
            let error = |step: f64| ((moved(step) - moved(-step)) / (2.0 * step) - analytic).abs() / d.scale();
            let errors = [1e-6, 1e-7, 1e-5].map(error);
            let best = errors.into_iter().fold(f64::INFINITY, f64::min);
            println!("{what}, {names:?}: {analytic:.3e}, error {best:.1e} of {errors:?}");
            assert!(best <= 1e-4, "{what}, {names:?}: {best:e}");
        }
    }
}

/// Activations of frames may be rounded where those of iterations are not.
#[test]
fn a_frame_does_not_depend_on_the_iteration_before_it() {
    let case = case(9, false, Factor::Full);
    let (gpu, raster, scene) = (gpu(), rasterizer(), &case.scene);
    let forward = raster.surface(&scene_splats(scene), &view_of(scene, 0.0)).unwrap();
    let sources: Vec<_> = scene.sources.iter().map(source_view).collect();
    let options = warping(scene);
    let visible = options.visible;
    let warper = Warper::new(gpu.clone(), options);
    let warped = warper.warp(&forward, &sources, warper.memory(&scene.camera).unwrap()).unwrap();
    let weights: Vec<f32> = case.weights.iter().map(|w| *w as f32).collect();
    let weights = gpu.upload("weights", &weights).unwrap();
    let task = ResidualTask { camera: scene.camera, seen: warped.seen.clone(), gain: 1.0 };
    let image = |residual: &Residual, keep| {
        let (base, warped, weights) = (forward.image.clone(), warped.colors.clone(), weights.clone());
        let inputs = ResidualInputs { base, warped, visible, weights };
        let pass = residual.forward(&task, inputs, keep, raster.image_memory(&scene.camera).unwrap()).unwrap();
        pixels(&pass.image, &scene.camera)
    };
    let [used, fresh] = [(); 2].map(|()| Residual::new(gpu.clone(), case.variant, Precision::Auto));
    image(&used, Keep::Gradients);
    assert!(image(&used, Keep::Image) == image(&fresh, Keep::Image));
}
