//! The normals that follow from a depth map against the twin.

use super::normal_loss::surface;
use ibgs_core::camera::Camera;
use ibgs_core::gpu::Pass;
use ibgs_reference::gpu::gpu;
use ibgs_reference::normal_loss::depth_normals;
use ibgs_reference::random_scene::random_camera;
use ibgs_reference::relative_error;
use ibgs_train::loss::SurfaceBuffers;

fn on_gpu(camera: &Camera, depth: &[f64]) -> Vec<f64> {
    let gpu = gpu();
    let narrow: Vec<f32> = depth.iter().map(|z| *z as f32).collect();
    let depth_map = gpu.upload("depth", &narrow).unwrap();
    let surface = SurfaceBuffers { depth: depth_map, ..SurfaceBuffers::new(&gpu, camera).unwrap() };
    let out = gpu.allocate("depth normals", 3 * depth.len()).unwrap();
    let mut pass = Pass::new(&gpu, "test");
    surface.record_depth_normals(&mut pass, &out);
    pass.submit();
    gpu.read(&out, 3 * depth.len()).unwrap().into_iter().map(f64::from).collect()
}

#[test]
fn every_size_follows_the_twin() {
    for (seed, (width, height)) in (0..).zip([(1, 1), (2, 5), (3, 3), (13, 9), (16, 16), (33, 17), (70, 50)]) {
        let camera = random_camera(width, height, seed);
        let (depth, _) = surface(&camera, seed, seed % 2 == 1);
        let (ours, truth) = (on_gpu(&camera, &depth), depth_normals(&camera, &depth));
        let error = relative_error(&ours, truth.as_flattened());
        println!("{width} x {height}: {error:.1e}");
        assert!(error <= 1e-5, "{width} x {height}: {error:e}");
        let inner = width >= 3 && height >= 3;
        assert_eq!(truth.as_flattened().iter().any(|v| *v != 0.0), inner, "{width} x {height}: nothing to compare");
    }
}

#[test]
fn a_frontal_plane_faces_the_camera_and_the_border_has_no_normal() {
    let camera = random_camera(24, 16, 7);
    let inner = |i: usize| (1..23).contains(&(i % 24)) && (1..15).contains(&(i / 24));
    for (i, normal) in on_gpu(&camera, &[2.5; 24 * 16]).chunks_exact(3).enumerate() {
        let expected = if inner(i) { [0.0, 0.0, -1.0] } else { [0.0; 3] };
        assert_eq!(normal, expected, "pixel {i}");
    }
}
