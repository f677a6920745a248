//! The true surface as a triangle mesh: the yardstick for extracted meshes.

use super::scene::scene;
use super::shape::{Form, Ray, Solid};
use glam::{DMat3, DVec3, Vec3};
use ibgs_data::camera::Camera;
use rayon::prelude::*;

/// Triangles in world space (metres); counter-clockwise seen from the free space of the room.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriangleMesh {
    /// Vertex positions in metres.
    pub vertices: Vec<[f32; 3]>,
    /// Indices of three vertices each.
    pub triangles: Vec<[u32; 3]>,
}

/// The whole true surface: the inside of the room, everything on the table and the lamps.
///
/// A box face is split into `tessellation` squares a side, a ball into six such faces, the ring into
/// `6 * tessellation` times `3 * tessellation` quads (0 counts as 1). Vertices lie exactly on the surfaces. Parts that
/// no camera sees, such as the underside of the table, are included; [`TriangleMesh::visible_from`] drops them.
pub fn mesh(tessellation: u32) -> TriangleMesh {
    let steps = tessellation.max(1);
    let scene = scene();
    let room = Solid { form: Form::Cuboid(scene.half()), center: scene.center(), world_from_local: DMat3::IDENTITY };
    let mut mesh = TriangleMesh::default();
    mesh.add_solid(&room, steps);
    for triangle in &mut mesh.triangles {
        triangle.swap(1, 2);
    }
    for object in &scene.objects {
        mesh.add_solid(&object.solid, steps);
    }
    for lamp in &scene.lamps {
        mesh.add_solid(&lamp.solid, steps);
    }
    mesh
}

impl TriangleMesh {
    /// The triangles whose centre at least one camera sees, against the true scene; unused vertices are dropped.
    /// A fair reference for a mesh made from these cameras' photos.
    pub fn visible_from(&self, cameras: &[Camera]) -> TriangleMesh {
        let seen: Vec<[u32; 3]> = self
            .triangles
            .par_iter()
            .copied()
            .filter(|&triangle| {
                let (center, normal) = self.center_and_normal(triangle);
                cameras.iter().any(|camera| sees(camera, center, normal))
            })
            .collect();
        let mut renamed = vec![u32::MAX; self.vertices.len()];
        let mut vertices = Vec::new();
        let mut rename = |index: u32| {
            let new = &mut renamed[index as usize];
            if *new == u32::MAX {
                *new = vertices.len() as u32;
                vertices.push(self.vertices[index as usize]);
            }
            *new
        };
        let triangles = seen.into_iter().map(|triangle| triangle.map(&mut rename)).collect();
        TriangleMesh { vertices, triangles }
    }

    fn center_and_normal(&self, triangle: [u32; 3]) -> (DVec3, DVec3) {
        let [a, b, c] = triangle.map(|i| Vec3::from(self.vertices[i as usize]).as_dvec3());
        ((a + b + c) / 3.0, (b - a).cross(c - a).normalize_or_zero())
    }

    fn add_solid(&mut self, solid: &Solid, steps: u32) {
        match solid.form {
            Form::Cuboid(half) => self.add_cube(solid, steps, |p| p * half),
            Form::Sphere(radius) => self.add_cube(solid, steps, |p| p.normalize() * radius),
            Form::Torus { major, minor } => self.add_torus(solid, steps, major, minor),
        }
    }

    /// The six faces of the cube `-1..1`, moved onto the surface by `shape`.
    fn add_cube(&mut self, solid: &Solid, steps: u32, shape: impl Fn(DVec3) -> DVec3) {
        for axis in 0..3 {
            for sign in [-1.0, 1.0] {
                self.add_grid(solid, [steps, steps], |i, j| {
                    let fraction = |k: u32| 2.0 * f64::from(k) / f64::from(steps) - 1.0;
                    let mut p = DVec3::ZERO;
                    p[axis] = sign;
                    // On the negative side the first direction is mirrored so that the face looks outwards.
                    p[(axis + 1) % 3] = sign * fraction(i);
                    p[(axis + 2) % 3] = fraction(j);
                    shape(p)
                });
            }
        }
    }

    fn add_torus(&mut self, solid: &Solid, steps: u32, major: f64, minor: f64) {
        let (around, across) = (6 * steps, 3 * steps);
        let turn = |k: u32, count: u32| {
            let angle = std::f64::consts::TAU * f64::from(k % count) / f64::from(count);
            super::numeric::sin_cos(angle)
        };
        self.add_grid(solid, [around, across], |i, j| {
            let ((sin, cos), (up, out)) = (turn(i, around), turn(j, across));
            let radius = major + minor * out;
            DVec3::new(radius * cos, radius * sin, minor * up)
        });
    }

    /// A grid of `size` quads with corners `local(i, j)`; the front is where `i` cross `j` points.
    fn add_grid(&mut self, solid: &Solid, size: [u32; 2], local: impl Fn(u32, u32) -> DVec3) {
        let first = self.vertices.len() as u32;
        for j in 0..=size[1] {
            for i in 0..=size[0] {
                let world = solid.center + solid.world_from_local * local(i, j);
                self.vertices.push(world.as_vec3().to_array());
            }
        }
        let at = |i: u32, j: u32| first + j * (size[0] + 1) + i;
        for j in 0..size[1] {
            for i in 0..size[0] {
                self.triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
                self.triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
    }
}

/// Whether a camera sees the front of a surface point. A flat triangle's centre lies up to a few centimetres inside a
/// coarsely tessellated ball, so the first hit may come that much before it.
fn sees(camera: &Camera, point: DVec3, normal: DVec3) -> bool {
    let (pixel, depth) = camera.project(point);
    let origin = camera.center();
    let offset = point - origin;
    if depth <= 0.0
        || normal.dot(offset) >= 0.0
        || pixel.min_element() < 0.0
        || pixel.x >= f64::from(camera.width)
        || pixel.y >= f64::from(camera.height)
    {
        return false;
    }
    let reach = offset.length();
    let hit = scene().nearest(&Ray { origin, direction: offset / reach });
    let slack = 2.0 * scene().distance(point) + 1e-4;
    hit.t + slack * reach / normal.dot(offset).abs().max(0.05 * reach) >= reach
}
