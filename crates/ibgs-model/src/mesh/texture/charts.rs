//! Charts: connected triangles that lie beside each other in a projection, without one on top of another.

use super::labels::{Candidate, NONE};
use super::texels::covered;
use super::view::View;
use crate::mesh::Mesh;
use glam::{Vec2, Vec3};
use std::collections::{HashMap, HashSet, VecDeque};

/// Texels along an edge of triangles that no photo sees.
const UNSEEN_TEXELS: f32 = 4.0;

/// Triangles that are laid out together.
pub struct Chart {
    /// Their indices.
    pub triangles: Vec<u32>,
    /// Their corners in pixels of the photo, from 0.
    pub corners: Vec<[Vec2; 3]>,
    /// The largest coordinates.
    pub size: Vec2,
}

/// How a triangle is laid out.
#[derive(Clone, Copy, PartialEq)]
enum Projection {
    /// As in the photo of this view.
    Photo(u32),
    /// Along the axis that is nearest to its normal, whichever way it looks.
    Axis(usize, bool),
}

struct Layout<'a> {
    mesh: &'a Mesh,
    views: &'a [View<'a>],
    projections: Vec<Projection>,
    /// Pixels for a unit of length along an axis.
    density: f32,
}

impl Layout<'_> {
    fn corners(&self, triangle: u32) -> [Vec2; 3] {
        self.mesh.triangles[triangle as usize].map(|vertex| {
            let point = Vec3::from(self.mesh.positions[vertex as usize]);
            match self.projections[triangle as usize] {
                Projection::Photo(view) => self.views[view as usize].project(point),
                Projection::Axis(axis, _) => Vec2::new(point[(axis + 1) % 3], point[(axis + 2) % 3]) * self.density,
            }
        })
    }

    /// Grows a chart from a triangle, over those that are not in one.
    fn grow(&self, first: u32, neighbours: &[[u32; 3]], placed: &mut [bool]) -> Chart {
        let projection = self.projections[first as usize];
        let mut chart = Chart { triangles: Vec::new(), corners: Vec::new(), size: Vec2::ZERO };
        let mut taken: HashSet<(i32, i32)> = HashSet::new();
        let mut queue = VecDeque::from([first]);
        while let Some(triangle) = queue.pop_front() {
            if placed[triangle as usize] || self.projections[triangle as usize] != projection {
                continue;
            }
            let corners = self.corners(triangle);
            let mut own = Vec::new();
            covered(corners, |x, y, _| own.push((x, y)));
            if own.iter().any(|texel| taken.contains(texel)) {
                continue;
            }
            taken.extend(own);
            placed[triangle as usize] = true;
            chart.triangles.push(triangle);
            chart.corners.push(corners);
            queue.extend(neighbours[triangle as usize].into_iter().filter(|&other| other != NONE));
        }
        chart
    }
}

/// Charts of all triangles, each in one. Triangles without a label are laid out along an axis, at the density that the best photo
/// has, or at a few texels an edge where no photo sees any of them.
pub fn charts(
    mesh: &Mesh,
    views: &[View],
    labels: &[Option<u32>],
    candidates: &[Vec<Candidate>],
    neighbours: &[[u32; 3]],
) -> Vec<Chart> {
    let best = |triangle: usize| candidates[triangle].first().map(|one| one.density.sqrt());
    let mut densities: Vec<f32> = (0..labels.len()).filter_map(best).collect();
    let middle = densities.len() / 2;
    let density = match densities.is_empty() {
        true => unseen_density(mesh, 0..labels.len() as u32),
        false => *densities.select_nth_unstable_by(middle, f32::total_cmp).1,
    };
    let projection = |(index, label): (usize, &Option<u32>)| match label {
        Some(view) => Projection::Photo(*view),
        None => {
            let normal = mesh.area(mesh.triangles[index]);
            let axis = normal.abs().max_position();
            Projection::Axis(axis, normal[axis] > 0.0)
        }
    };
    let projections = labels.iter().enumerate().map(projection).collect();
    let layout = Layout { mesh, views, projections, density };
    let mut placed = vec![false; labels.len()];
    let mut charts = Vec::new();
    for first in 0..labels.len() as u32 {
        if placed[first as usize] {
            continue;
        }
        let mut chart = layout.grow(first, neighbours, &mut placed);
        let mut scale = 1.0;
        if labels[first as usize].is_none() {
            let seen: Vec<f32> = chart.triangles.iter().filter_map(|&triangle| best(triangle as usize)).collect();
            let own = match seen.is_empty() {
                true => unseen_density(mesh, chart.triangles.iter().copied()).min(density),
                false => seen.iter().sum::<f32>() / seen.len() as f32,
            };
            scale = own / density;
        }
        chart.settle(scale);
        charts.push(chart);
    }
    charts
}

fn unseen_density(mesh: &Mesh, triangles: impl ExactSizeIterator<Item = u32> + Clone) -> f32 {
    let count = triangles.len() as f32;
    let area: f32 = triangles.map(|triangle| mesh.area(mesh.triangles[triangle as usize]).length()).sum();
    if area > 0.0 { UNSEEN_TEXELS * (count / area).sqrt() } else { 1.0 }
}

impl Chart {
    /// Scales it and moves it to 0.
    fn settle(&mut self, scale: f32) {
        let points = || self.corners.iter().flatten();
        let low = points().fold(Vec2::INFINITY, |a, b| a.min(*b));
        self.corners.iter_mut().flatten().for_each(|corner| *corner = (*corner - low) * scale);
        self.size = self.corners.iter().flatten().fold(Vec2::ZERO, |a, b| a.max(*b));
    }

    /// The mesh's vertices that it has, in the order of their first use, each with its corner.
    pub fn vertices(&self, mesh: &Mesh) -> (Vec<(u32, Vec2)>, Vec<[u32; 3]>) {
        let mut numbers: HashMap<u32, u32> = HashMap::new();
        let mut found = Vec::new();
        let mut number = |vertex: u32, corner: Vec2| {
            *numbers.entry(vertex).or_insert_with(|| {
                found.push((vertex, corner));
                found.len() as u32 - 1
            })
        };
        let all = self.triangles.iter().zip(&self.corners);
        let triangles = all
            .map(|(&triangle, corners)| {
                let vertices = mesh.triangles[triangle as usize];
                [0, 1, 2].map(|i| number(vertices[i], corners[i]))
            })
            .collect();
        (found, triangles)
    }
}
