//! Normals from the Gaussians' shortest axes.

use glam::{DMat3, DQuat, DVec3};
use ibgs_reference::gpu::{gpu, rasterizer, splats};
use ibgs_reference::random_scene::random_params;

#[test]
fn the_normal_is_the_axis_of_the_least_scale() {
    let mut p = random_params(300, 0, 7);
    // Of equal ones the first counts.
    p.log_scales[0] = [-2.0; 3];
    p.log_scales[1] = [-1.0, -2.0, -2.0];
    let splats = splats(&p);
    rasterizer().shape_normals(&splats);
    let gpu = gpu();
    let normals = gpu.read(&splats.parameters.normals.cast::<[f32; 3]>(), p.len()).unwrap();
    let offsets = gpu.read(&splats.parameters.offsets, p.len()).unwrap();
    assert!(offsets.iter().all(|offset| *offset == 0.0));
    for (i, normal) in normals.iter().enumerate() {
        let [w, x, y, z] = p.rotations[i];
        let axes = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
        let scales = p.log_scales[i];
        let least = (0..3).min_by(|&a, &b| scales[a].total_cmp(&scales[b])).unwrap();
        let error = (DVec3::from(normal.map(f64::from)) - axes.col(least)).length();
        assert!(error < 1e-5, "{i}: {normal:?} against {}", axes.col(least));
    }
}
