//! Ground truth of the demo scene: its surface, and its normals in a view.

use glam::Vec3;
use ibgs_core::camera::Camera;
use ibgs_core::mesh::score::Cloud;
use ibgs_demo::TriangleMesh;

/// Squares along the side of a box, of the true mesh; the largest, those of the room, are 7 centimetres long.
const TESSELLATION: u32 = 64;

/// Points of the true surface.
#[derive(Clone, Debug)]
pub struct TrueSurface {
    /// All of it.
    pub all: Cloud,
    /// The triangles whose centre some camera sees from the front: the part that a capture can reconstruct.
    pub seen: Cloud,
}

impl TrueSurface {
    /// Samples the true surface with points no farther apart than `spacing` metres.
    pub fn sample(cameras: &[Camera], spacing: f64) -> Self {
        let mesh = ibgs_demo::mesh(TESSELLATION);
        let cloud = |mesh: &TriangleMesh| Cloud::of_triangles(&mesh.vertices, &mesh.triangles, spacing);
        Self { all: cloud(&mesh), seen: cloud(&mesh.visible_from(cameras)) }
    }
}

/// Angles in degrees between a rendered normal map (`[H * W * 3]`, camera space, of any length) and the true normals, at the
/// pixels that have a normal.
pub fn normal_map_errors(camera: &Camera, normals: &[f32]) -> Vec<f32> {
    let truth = ibgs_demo::truth(camera).normal;
    let world_from_view = camera.view_from_world.transpose().as_mat3();
    let pairs = normals.as_chunks::<3>().0.iter().zip(truth);
    let angle = |(normal, truth): (&[f32; 3], [f32; 3])| {
        let normal = Vec3::from(*normal).try_normalize()?;
        Some((world_from_view * normal).dot(truth.into()).clamp(-1.0, 1.0).acos().to_degrees())
    };
    pairs.filter_map(angle).collect()
}
