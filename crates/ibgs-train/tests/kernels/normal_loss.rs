//! The normal loss against its twin, forward and backward.

use crate::common::values;
use burn::tensor::{Tensor, TensorData};
use ibgs_core::camera::Camera;
use ibgs_core::dataset::Photo;
use ibgs_core::sources::DevicePhoto;
use ibgs_reference::gpu::gpu;
use ibgs_reference::normal_loss::{Surface, normal_loss, normal_loss_backward};
use ibgs_reference::random_scene::{exact, random_camera, random_image};
use ibgs_reference::relative_error;
use ibgs_train::loss::{NormalLoss, SurfaceBuffers};
use ibgs_train::tensor::device;

const WEIGHT: f64 = 0.03;
/// What stands in the gradient buffers before.
const BEFORE: f32 = 0.0625;

struct OnGpu {
    loss: f64,
    v_depth: Vec<f64>,
    v_normal: Vec<f64>,
}

/// Loss and gradients on the GPU; the upstream gradient is 3. The gradients are what was added to `before`.
fn on_gpu(seen: Surface, depth: &[f64], normal: &[[f64; 3]], before: f32) -> OnGpu {
    let (gpu, camera) = (gpu(), seen.camera);
    let rgba = seen.valid.iter().flat_map(|valid| [7, 7, 7, if *valid { 128 } else { 127 }]).collect();
    let photo = DevicePhoto::upload(&gpu, &Photo { width: camera.width, height: camera.height, rgba }).unwrap();
    let narrow = |v: &[f64]| -> Vec<f32> { v.iter().map(|x| *x as f32).collect() };
    let surface = SurfaceBuffers {
        depth: gpu.upload("depth", &narrow(depth)).unwrap(),
        normal: gpu.upload("normal", &narrow(normal.as_flattened())).unwrap(),
        v_depth: gpu.upload("v_depth", &vec![before; depth.len()]).unwrap(),
        v_normal: gpu.upload("v_normal", &vec![before; 3 * depth.len()]).unwrap(),
        ..SurfaceBuffers::new(&gpu, camera).unwrap()
    };
    let pixels = depth.len();
    let shape = [camera.height as usize, camera.width as usize, 3];
    let image = Tensor::<3>::from_data(TensorData::new(vec![0.5f32; 3 * pixels], shape), device(&gpu).unwrap());
    let leaf = image.autodiff().require_grad();
    let produced = leaf.clone() * 2.0;
    let loss = NormalLoss::new(gpu.clone(), WEIGHT as f32).tracked(&produced, &surface, &photo).unwrap();
    let mut grads = (loss.clone() * 3.0 + produced.sum()).backward();
    let by_image = values(leaf.grad_remove(&mut grads).unwrap());
    assert!(by_image.iter().all(|v| *v == 2.0), "the image has no gradient from the normal loss");
    let read =
        |buffer, count| -> Vec<f64> { gpu.read::<f32>(buffer, count).unwrap().into_iter().map(f64::from).collect() };
    OnGpu {
        loss: values(loss.inner())[0],
        v_depth: read(&surface.v_depth, pixels),
        v_normal: read(&surface.v_normal, 3 * pixels),
    }
}

/// A wavy surface with holes where nothing was met, and normals of every length.
pub(super) fn surface(camera: &Camera, seed: u64, holes: bool) -> (Vec<f64>, Vec<[f64; 3]>) {
    let noise = random_image(camera.width, camera.height, 0.0, 1.0, seed);
    let depth = |(i, n): (usize, &[f64; 3])| {
        let (x, y) = ((i as u32 % camera.width) as f64, (i as u32 / camera.width) as f64);
        let hole = holes && n[2] < 0.15;
        if hole { 0.0 } else { exact(3.0 + (0.2 * x).sin() + 0.05 * y + 0.02 * n[0]) }
    };
    let depth = noise.iter().enumerate().map(depth).collect();
    (depth, random_image(camera.width, camera.height, -1.0, 1.0, seed + 1))
}

#[test]
fn loss_and_gradients_follow_the_twin_at_every_size() {
    for (seed, (width, height)) in (0..).zip([(1, 1), (2, 5), (3, 3), (13, 9), (16, 16), (33, 17), (70, 50)]) {
        let camera = random_camera(width, height, seed);
        let (depth, normal) = surface(&camera, seed, seed % 2 == 1);
        // Every other size has a mask.
        let valid: Vec<bool> = (0..depth.len()).map(|i| seed % 2 == 0 || i % 5 != 1).collect();
        let seen = Surface { camera: &camera, valid: &valid };
        let ours = on_gpu(seen, &depth, &normal, 0.0);
        let what = format!("{width} x {height}");
        let expected = normal_loss(seen, &depth, &normal, WEIGHT);
        let error = (ours.loss - expected).abs() / expected;
        let (v_depth, v_normal) = normal_loss_backward(seen, &depth, &normal, 3.0 * WEIGHT);
        let by_depth = relative_error(&ours.v_depth, &v_depth);
        let by_normal = relative_error(&ours.v_normal, v_normal.as_flattened());
        println!("{what}: loss {error:.1e}, by depth {by_depth:.1e}, by normal {by_normal:.1e}");
        assert!(error <= 1e-5, "{what}: loss {} against {expected}", ours.loss);
        assert!(by_depth <= 1e-4 && by_normal <= 1e-5, "{what}");
        for (a, b) in ours.v_depth.iter().zip(&v_depth) {
            assert!(*b != 0.0 || *a == 0.0, "{what}: {a} where the truth is zero");
        }
        assert_eq!(v_depth.iter().any(|v| *v != 0.0), width >= 3 && height >= 3, "{what}: gradient by depth");
        assert!(v_normal.as_flattened().iter().any(|v| *v != 0.0), "{what}: gradient by normal");
    }
}

#[test]
fn gradients_are_added_to_what_is_there() {
    let camera = random_camera(33, 17, 5);
    let (depth, normal) = surface(&camera, 5, true);
    let seen = Surface { camera: &camera, valid: &vec![true; depth.len()] };
    let fresh = on_gpu(seen, &depth, &normal, 0.0);
    let added = on_gpu(seen, &depth, &normal, BEFORE);
    let same = |sum: &[f64], part: &[f64]| {
        let expected = |v: &f64| f64::from(BEFORE + *v as f32);
        sum.iter().zip(part).all(|(a, b)| *a == expected(b))
    };
    assert!(same(&added.v_depth, &fresh.v_depth) && same(&added.v_normal, &fresh.v_normal));
}

#[test]
fn the_normals_of_a_frontal_plane_cost_only_the_border() {
    let camera = random_camera(24, 16, 7);
    let depth = vec![2.5; 24 * 16];
    let normal = vec![[0.0, 0.0, -1.0]; 24 * 16];
    let ours = on_gpu(Surface { camera: &camera, valid: &[true; 24 * 16] }, &depth, &normal, 0.0);
    let border = (24.0 * 16.0 - 22.0 * 14.0) / (24.0 * 16.0);
    assert!((ours.loss - WEIGHT * border).abs() < 1e-8, "{} for a border of {border}", ours.loss);
    assert!(ours.v_depth.iter().all(|v| v.abs() < 1e-9), "nothing to gain by another depth");
}

#[test]
fn what_the_photo_masks_has_no_part() {
    let camera = random_camera(33, 17, 6);
    let (depth, normal) = surface(&camera, 6, false);
    // The right half is masked: beside the border of the mask its depth still makes the normals of the left half.
    let valid: Vec<bool> = (0..depth.len()).map(|i| i % 33 < 16).collect();
    let masked = on_gpu(Surface { camera: &camera, valid: &valid }, &depth, &normal, BEFORE);
    let open = on_gpu(Surface { camera: &camera, valid: &vec![true; depth.len()] }, &depth, &normal, BEFORE);
    assert!(masked.loss > 0.0 && masked.loss < 0.7 * open.loss, "{} of {}", masked.loss, open.loss);
    for (i, v) in masked.v_depth.iter().enumerate().filter(|(i, _)| i % 33 > 16) {
        assert!(*v == f64::from(BEFORE) && masked.v_normal[3 * i..3 * i + 3] == [f64::from(BEFORE); 3], "pixel {i}");
    }
    assert!(open.v_depth.iter().enumerate().any(|(i, v)| i % 33 > 16 && *v != f64::from(BEFORE)));
}
