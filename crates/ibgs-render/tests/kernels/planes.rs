//! The Gaussians' planes in the camera's space against the twin.

use glam::DVec3;
use ibgs_reference::geometry::Plane;
use ibgs_reference::gpu::{gpu, scene_splats};
use ibgs_reference::surface_scene::wall;
use ibgs_render::gpu::Pass;
use ibgs_shaders::bindings::PlanesBindings;
use ibgs_shaders::types::ViewUniforms;

#[test]
fn planes_follow_the_twin_and_face_the_camera() {
    let gpu = gpu();
    let mut scene = wall(3, 4);
    // A normal without direction gives a plane that no ray meets, one that is turned around the same plane.
    scene.planes.normals[0] = [0.0; 3];
    scene.planes.normals[1] = scene.planes.normals[1].map(|v| -v);
    let (n, camera) = (scene.params.len(), scene.camera);
    let splats = scene_splats(&scene);
    let rotation = camera.view_from_world.transpose();
    let [row0, row1, row2] = [0, 1, 2].map(|i| rotation.col(i).extend(camera.translation[i]).as_vec4().to_array());
    let center = camera.center().as_vec3().to_array();
    let uniforms = ViewUniforms { row0, row1, row2, center, count: n as u32, ..ViewUniforms::default() };
    let planes = gpu.upload("planes", &vec![[f32::NAN; 4]; n]).unwrap();
    let p = &splats.parameters;
    let buffers = PlanesBindings { means: &p.means, normals: &p.normals, plane_offsets: &p.offsets, planes: &planes };
    let mut pass = Pass::new(&gpu, "test");
    pass.linear(&buffers, &uniforms, n);
    pass.submit();
    let ours = gpu.read(&planes, n).unwrap();
    assert_eq!(ours[0], [0.0; 4]);
    for (i, ours) in ours.iter().enumerate() {
        let (mean, normal) = (DVec3::from(scene.params.means[i]), DVec3::from(scene.planes.normals[i]));
        let truth = Plane::new(mean, normal, scene.planes.offsets[i], &camera);
        let truth = truth.normal.extend(truth.distance);
        let error = (glam::Vec4::from(*ours).as_dvec4() - truth).abs().max_element();
        assert!(error < 1e-5, "{i}: {ours:?} against {truth}");
        assert!(i == 0 || truth.w > 0.0, "{i}: nothing to compare");
    }
}
