//! The residual network and the final image of the published implementation's dump.

use super::surface::golden_dump;
use ibgs_core::camera::Camera;
use ibgs_core::gpu::Buffer;
use ibgs_core::gpu::Pass;
use ibgs_core::raster::Keep;
use ibgs_core::residual::ResidualInputs;
use ibgs_core::residual::features::{FeatureInputs, Features};
use ibgs_core::residual::layers::OUTPUTS;
use ibgs_core::residual::{Arithmetic, Precision, Residual, ResidualTask, UNet, Variant, weights};
use ibgs_core::sources::{WarpOptions, Warper};
use ibgs_reference::geometry::pixel_ray;
use ibgs_reference::golden::{Golden, load_golden};
use ibgs_reference::gpu::view_of;
use ibgs_reference::gpu::{gpu, rasterizer, scene_splats, source_view};
use ibgs_reference::psnr;
use ibgs_reference::surface_scene::Scene;
use ibgs_reference::warp::{DEPTH_AGREEMENT, Pair, Source};
use ibgs_testing::shared;

/// Visible sources that enter the network.
const VISIBLE: usize = 3;

/// The dump's network, for the test of this name.
fn load_weights(test: &str) -> Option<Vec<f32>> {
    Some(weights::load(&shared("golden/color_aggregation_network.pth", test)?).unwrap())
}

/// The target camera as the residual stage must see it to have the dump's rays, which pass through x = column.
fn ray_camera(camera: &Camera) -> Camera {
    Camera { principal: camera.principal + 0.5, ..*camera }
}

/// What the network saw in the dump.
struct Inputs {
    /// (Colour, cosine), V x pixels.
    warped: Vec<[f32; 4]>,
    seen: Vec<u32>,
    centers: Vec<[f32; 4]>,
}

/// The visible sources of the dump; the centre difference tells the source.
fn dumped_inputs(golden: &Golden) -> Inputs {
    let pixels = golden.base.len();
    let feature = &golden.arrays.get("cam_feat").data;
    let centers: Vec<glam::DVec3> =
        golden.source_cameras.iter().map(|source| golden.camera.center() - source.center()).collect();
    let mut seen = vec![u32::MAX; pixels];
    let mut warped = vec![[0.0; 4]; VISIBLE * pixels];
    let mut farthest = 0.0f64;
    for m in 0..VISIBLE {
        let colors = golden.arrays.get("warped_image").image(m);
        for p in 0..pixels {
            let [x, y, z, cosine] = std::array::from_fn(|c| feature[(4 * m + c) * pixels + p]);
            if [x, y, z, cosine] == [0.0; 4] {
                continue;
            }
            let distance = |i: &usize| centers[*i].distance(glam::DVec3::new(x, y, z));
            let source = (0..centers.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap();
            farthest = farthest.max(distance(&source));
            seen[p] = seen[p] & !(255 << (8 * m)) | (source as u32) << (8 * m);
            let [r, g, b] = colors[p];
            warped[m * pixels + p] = [r, g, b, cosine].map(|v| v as f32);
        }
    }
    println!("centre differences: {farthest:.1e} from those of the cameras");
    assert!(farthest < 5e-3, "each is one of the sources");
    let centers = centers.iter().map(|c| c.extend(0.0).as_vec4().to_array()).collect();
    Inputs { warped, seen, centers }
}

fn single(map: &[[f64; 3]]) -> Vec<f32> {
    map.as_flattened().iter().map(|v| *v as f32).collect()
}

#[test]
fn the_network_gives_the_dumped_residual() {
    let test = "gradients::golden_final::the_network_gives_the_dumped_residual";
    let Some(golden) = load_golden(test) else { return };
    let Some(weights) = load_weights(test) else { return };
    let gpu = gpu();
    let inputs = dumped_inputs(&golden);
    let camera = ray_camera(&golden.camera);
    let base = gpu.upload("base", &single(&golden.base)).unwrap();
    let warped = gpu.upload("warped", &inputs.warped).unwrap();
    let seen = gpu.upload("seen", &inputs.seen).unwrap();
    let most_visible = gpu.upload("most_visible", &[VISIBLE as u32, 0, 0, 0]).unwrap();
    let centers = gpu.upload("centres", &inputs.centers).unwrap();
    let weights = gpu.upload("weights", &weights).unwrap();
    let features = FeatureInputs {
        base: &base,
        warped: &warped,
        seen: &seen,
        most_visible: &most_visible,
        centers: &centers,
        weights: &weights,
    };
    let unet = UNet::new(&gpu, [camera.width, camera.height], Keep::Image, Arithmetic::Full).unwrap();
    let mut pass = Pass::new(&gpu, "test");
    Features::new(&camera, VISIBLE as u32, Variant::default()).record(&mut pass, &features, unet.x());
    unet.forward(&mut pass, &weights);
    pass.submit();
    let pixels = golden.base.len();
    let x = gpu.read(unet.x(), 35 * pixels).unwrap();
    let rays = golden.arrays.get("camera_ray").image(0);
    let ray_error = |(i, ray): (usize, &[f64; 3])| {
        (0..3).map(|c| (f64::from(x[(32 + c) * pixels + i]) - ray[c]).abs()).fold(0.0, f64::max)
    };
    let by_ray = rays.iter().enumerate().map(ray_error).fold(0.0, f64::max);
    let output: Vec<[f32; OUTPUTS]> = gpu.read(unet.residual(), pixels).unwrap();
    let residual: Vec<f32> = output.iter().flat_map(|v| [v[0], v[1], v[2]]).collect();
    let truth = golden.arrays.get("residual").image(0);
    let errors: Vec<f64> = residual.iter().zip(truth.as_flattened()).map(|(a, b)| (f64::from(*a) - b).abs()).collect();
    let worst = errors.iter().copied().fold(0.0, f64::max);
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    println!("rays within {by_ray:.1e}; residual within {worst:.1e}, {mean:.1e} in the mean");
    assert!(by_ray <= 1e-3, "rays: {by_ray:e}");
    assert!(worst <= 5e-4, "residual: {worst:e}");
    let sum: Vec<f64> = residual.iter().zip(golden.base.as_flattened()).map(|(r, base)| f64::from(*r) + base).collect();
    let db = psnr(&sum, golden.arrays.get("final").image(0).as_flattened());
    println!("final from the dump's own inputs: {db:.1} dB");
    assert!(db >= 80.0, "final from the dump's own inputs: {db:.1} dB");
}

/// Numbers of the first visible sources, 255 where there is none.
fn packed(word: u32) -> [u8; VISIBLE] {
    std::array::from_fn(|m| word.to_le_bytes()[m])
}

/// Asserts that a pixel where ours and the dump pack different sources lies on the threshold of the depth test: within
/// the error of the published code's reads of the source's depth map, whose texel fractions have 8 bits.
fn assert_on_threshold(scene: &Scene, pixel: usize, depth: f64, ours: [u8; VISIBLE], dumped: [u8; VISIBLE]) {
    let (a, b) = ours.into_iter().zip(dumped).find(|(a, b)| a != b).expect("a difference there is");
    let source = &scene.sources[usize::from(a.min(b))];
    let shifted = Source { camera: ray_camera(&source.camera), ..source.clone() };
    let target = ray_camera(&scene.camera);
    let (x, y) = (pixel as u32 % target.width, pixel as u32 / target.width);
    let pair = Pair::new(&target, &shifted);
    let landing = pair.land(pixel_ray(&target, x, y), depth).expect("inside the source's image");
    let [stored] = landing.read.read(shifted.depth.as_chunks().0);
    let slope: f64 = landing.read.slope::<1>(shifted.depth.as_chunks().0).iter().map(|s| s[0].abs()).sum();
    let margin = ((stored - landing.depth).abs() / landing.depth - DEPTH_AGREEMENT).abs();
    let allowed = slope / 256.0 / landing.depth + 1e-6;
    println!("pixel ({x}, {y}): {ours:?} for {dumped:?}; {margin:.1e} from the threshold, {allowed:.1e} by the read");
    assert!(margin <= allowed, "pixel ({x}, {y}): {margin:e} from the threshold, {allowed:e} allowed");
}

/// Errors of our final image.
fn report(what: &str, ours: &[f64], dumped: &[f64]) -> f64 {
    let mut errors: Vec<f64> = ours.iter().zip(dumped).map(|(a, b)| (a - b).abs()).collect();
    errors.sort_by(f64::total_cmp);
    let [median, p99, p999, worst] = [0.5, 0.99, 0.999, 1.0].map(|q| errors[((errors.len() - 1) as f64 * q) as usize]);
    let db = psnr(ours, dumped);
    println!(
        "{what}: {db:.1} dB; error {median:.1e} (median), {p99:.1e} (99 %), {p999:.1e} (99.9 %), {worst:.1e} (worst)"
    );
    db
}

/// A source seen by one and not by the other changes the residual around a pixel, which is nobody's error: there are a
/// few such pixels, they lie on the threshold of the depth test, and given the dump's sources at them our final image is
/// the dump's everywhere.
#[test]
fn a_published_model_gives_its_final_image() {
    let test = "gradients::golden_final::a_published_model_gives_its_final_image";
    let Some((golden, scene)) = golden_dump(test) else { return };
    let Some(weights) = load_weights(test) else { return };
    let gpu = gpu();
    let (raster, model, view) = (rasterizer(), scene_splats(&scene), view_of(&scene, 0.0));
    let forward = raster.surface(&model, &view).unwrap();
    let sources: Vec<_> = scene.sources.iter().map(source_view).collect();
    let options = WarpOptions { visible: VISIBLE as u32, ..WarpOptions::default() };
    let warper = Warper::new(gpu.clone(), options);
    let warped = warper.warp(&forward, &sources, warper.memory(&view.camera).unwrap()).unwrap();
    let seen = &warped.seen;
    let weights = gpu.upload("weights", &weights).unwrap();
    let task = ResidualTask { camera: ray_camera(&scene.camera), seen: seen.clone(), gain: 1.0 };
    let residual = Residual::new(gpu.clone(), Variant::default(), Precision::Full);
    let render = |warped: &Buffer<[f32; 4]>| {
        let (base, weights) = (forward.image.clone(), weights.clone());
        let inputs = ResidualInputs { base, warped: warped.clone(), visible: VISIBLE as u32, weights };
        let image = raster.image_memory(&view.camera).unwrap();
        let pass = residual.forward(&task, inputs, Keep::Image, image).unwrap();
        ibgs_reference::gpu::pixels(&pass.image, &view.camera)
    };
    let image = render(&warped.colors);

    let pixels = golden.base.len();
    let dumped = dumped_inputs(&golden);
    let mut words = gpu.read(&seen.visible, pixels).unwrap();
    let mut colors = gpu.read(&warped.colors, VISIBLE * pixels).unwrap();
    let depth = gpu.read(&forward.surface().unwrap().median_depth, pixels).unwrap();
    let flipped: Vec<usize> = (0..pixels).filter(|p| packed(words[*p]) != packed(dumped.seen[*p])).collect();
    for p in &flipped {
        assert_on_threshold(&scene, *p, depth[*p].into(), packed(words[*p]), packed(dumped.seen[*p]));
        words[*p] = dumped.seen[*p];
        (0..VISIBLE).for_each(|m| colors[m * pixels + p] = dumped.warped[m * pixels + p]);
    }
    let share = flipped.len() as f64 / pixels as f64;
    println!("{} of {pixels} pixels ({:.3} %) see other sources", flipped.len(), 100.0 * share);
    gpu.write(&seen.visible, 0, &words);
    let patched = render(&gpu.upload("colours", &colors).unwrap());

    let base = ibgs_reference::gpu::pixels(&forward.image, &view.camera);
    let truth: Vec<f64> =
        golden.arrays.get("ground_truth").image(0).into_flattened().iter().map(|v| v / 255.0).collect();
    let clamped = |image: &[f64]| image.iter().map(|v| v.clamp(0.0, 1.0)).collect::<Vec<_>>();
    let (by_base, by_final) = (psnr(&clamped(&base), &truth), psnr(&clamped(&image), &truth));
    let last = golden.arrays.get("final").image(0);
    report("base", &base, golden.base.as_flattened());
    let alone = report("final", &image, last.as_flattened());
    let given = report("final, given the dump's sources at these pixels", &patched, last.as_flattened());
    println!("against the photo: base {by_base:.3} dB, final {by_final:.3} dB; published 31.51 and 32.92");
    assert!((by_base - 31.51).abs() < 0.01 && (by_final - 32.92).abs() < 0.01, "PSNR against the photo");
    assert!(share <= 5e-4, "{share} of the pixels see other sources");
    assert!(alone >= 70.0 && given >= 80.0, "final image: {alone:.1} dB, {given:.1} dB");
}
