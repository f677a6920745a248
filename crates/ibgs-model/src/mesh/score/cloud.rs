//! Points on a surface: sampled, moved, cropped, thinned.

use super::CropVolume;
use crate::mesh::Mesh;
use glam::{DMat4, DVec3, IVec3, Vec3};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use std::collections::HashMap;

/// Points on a surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cloud {
    /// Positions.
    pub points: Vec<DVec3>,
    /// Unit normals of the points; empty where they are not known.
    pub normals: Vec<DVec3>,
}

/// Parts of a triangle's sides that are no longer than `spacing`.
fn steps([a, b, c]: [DVec3; 3], spacing: f64) -> f64 {
    let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
    (longest / spacing).ceil().max(1.0)
}

impl Cloud {
    /// Points without normals.
    pub fn new(points: Vec<DVec3>) -> Self {
        Self { points, normals: Vec::new() }
    }

    /// The vertices that triangles use, and on each triangle a grid of points no farther apart than `spacing`, with the
    /// triangles' normals. Triangles without area have no points.
    pub fn of_triangles(positions: &[[f32; 3]], triangles: &[[u32; 3]], spacing: f64) -> Self {
        let mut cloud = Self::default();
        let mut used = vec![false; positions.len()];
        for triangle in triangles {
            let [a, b, c] = triangle.map(|i| Vec3::from(positions[i as usize]).as_dvec3());
            let Some(normal) = (b - a).cross(c - a).try_normalize() else { continue };
            let mut add = |point| {
                cloud.points.push(point);
                cloud.normals.push(normal);
            };
            for (&i, point) in triangle.iter().zip([a, b, c]) {
                if !std::mem::replace(&mut used[i as usize], true) {
                    add(point);
                }
            }
            let steps = steps([a, b, c], spacing) as u32;
            let part = |k: u32| (f64::from(k) + 1.0 / 3.0) / f64::from(steps);
            for i in 0..steps {
                (0..steps - i).for_each(|j| add(a + part(i) * (b - a) + part(j) * (c - a)));
            }
        }
        cloud
    }

    /// [`Cloud::of_triangles`] of a mesh, in the scene's coordinates.
    pub fn of_mesh(mesh: &Mesh, spacing: f64) -> Self {
        Self::of_triangles(&mesh.positions, &mesh.triangles, spacing).shifted(mesh.offset)
    }

    /// Number of points in the grid that [`Cloud::of_triangles`] puts on a triangle.
    pub(super) fn samples(corners: [DVec3; 3], spacing: f64) -> f64 {
        let steps = steps(corners, spacing);
        steps * (steps + 1.0) / 2.0
    }

    pub(super) fn shifted(mut self, offset: DVec3) -> Self {
        self.points.iter_mut().for_each(|point| *point += offset);
        self
    }

    /// Moved by a matrix, normals turned with it.
    pub fn moved(mut self, matrix: DMat4) -> Self {
        for point in &mut self.points {
            *point = matrix.transform_point3(*point);
        }
        for normal in &mut self.normals {
            *normal = matrix.transform_vector3(*normal).normalize_or_zero();
        }
        self
    }

    /// The points inside a volume.
    pub fn cropped(&self, volume: &CropVolume) -> Self {
        self.chosen(|i| volume.holds(self.points[i]))
    }

    fn chosen(&self, keep: impl Fn(usize) -> bool) -> Self {
        let kept: Vec<usize> = (0..self.points.len()).filter(|&i| keep(i)).collect();
        let of = |values: &[DVec3]| kept.iter().filter_map(|&i| values.get(i).copied()).collect();
        Self { points: of(&self.points), normals: of(&self.normals) }
    }

    /// The mean of the points in each voxel of a grid that begins half a voxel below the least corner, in the order of the first
    /// point of each.
    pub(crate) fn averaged(&self, voxel: f64) -> Self {
        let least = self.points.iter().copied().fold(DVec3::INFINITY, DVec3::min) - 0.5 * voxel;
        let mut places: HashMap<[i64; 3], usize> = HashMap::new();
        let mut sums: Vec<(DVec3, DVec3, f64)> = Vec::new();
        for (i, &point) in self.points.iter().enumerate() {
            let key = ((point - least) / voxel).floor().to_array().map(|v| v as i64);
            let place = *places.entry(key).or_insert(sums.len());
            if place == sums.len() {
                sums.push(Default::default());
            }
            let (points, normals, count) = &mut sums[place];
            *points += point;
            *normals += self.normals.get(i).copied().unwrap_or_default();
            *count += 1.0;
        }
        let points = sums.iter().map(|(sum, _, count)| *sum / *count).collect();
        let normals = sums.iter().filter(|_| !self.normals.is_empty()).map(|(_, sum, _)| sum.normalize_or_zero());
        Self { points, normals: normals.collect() }
    }

    /// A part of the points of which no two are nearer than `least`, chosen in a random order that is always the same.
    pub(crate) fn spread(&self, least: f64) -> Self {
        let mut order: Vec<u32> = (0..self.points.len() as u32).collect();
        order.shuffle(&mut ChaCha8Rng::seed_from_u64(0));
        // At most one point has its cell to itself: cells are smaller than the distance.
        let cell = least / 3_f64.sqrt();
        let key = |point: DVec3| (point / cell).floor().to_array().map(|v| v as i64);
        let mut taken: HashMap<[i64; 3], DVec3> = HashMap::new();
        let mut keep = vec![false; self.points.len()];
        // A point nearer than `least` lies at most two cells away.
        let steps: Vec<IVec3> = (0..125).map(|i| IVec3::new(i % 5, i / 5 % 5, i / 25) - 2).collect();
        for &i in &order {
            let point = self.points[i as usize];
            let [x, y, z] = key(point);
            let near = |step: &IVec3| {
                let other = taken.get(&[x + i64::from(step.x), y + i64::from(step.y), z + i64::from(step.z)]);
                other.is_some_and(|other| other.distance(point) < least)
            };
            if taken.contains_key(&[x, y, z]) || steps.iter().any(near) {
                continue;
            }
            taken.insert([x, y, z], point);
            keep[i as usize] = true;
        }
        self.chosen(|i| keep[i])
    }
}
