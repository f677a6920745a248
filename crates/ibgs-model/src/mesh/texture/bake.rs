//! Colours of the texels. A colour depends on the point of the surface alone, so charts of different photos meet without a seam.
//! Where other photos are the best ones the light may differ: the colours of the vertices level that.

use super::atlas::{PADDING, extent};
use super::charts::Chart;
use super::labels::Candidate;
use super::texels::covered;
use super::view::View;
use crate::mesh::Mesh;
use glam::{IVec2, UVec2, Vec2, Vec3, Vec4};
use rayon::prelude::*;

/// Photos that a texel is the mean of.
const PHOTOS: usize = 8;

/// Times that the levels are smoothed.
const SMOOTHINGS: usize = 16;

/// Texels of a chart with its padding, row by row.
pub struct Baked {
    pub size: UVec2,
    pub rgb: Vec<[u8; 3]>,
    /// Texels in triangles, and those of them that a photo sees.
    pub covered: usize,
    pub seen: usize,
}

/// The colour of a surface point, and whether photos give it: the mean of the best ones that see it. The weight of each is what it
/// has beyond the first that is left out, so that no photo comes or goes at once.
fn color(views: &[View], candidates: &[Candidate], point: Vec3, normal: Vec3) -> Option<Vec3> {
    let mut found: Vec<(f32, &View)> = Vec::with_capacity(candidates.len());
    for candidate in candidates {
        let view = &views[candidate.view as usize];
        let density = view.density(point, normal);
        let score = if density > 0.0 { density * view.sees(point) } else { 0.0 };
        if score > 0.0 {
            found.push((score, view));
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let colors = found.iter().filter_map(|&(score, view)| Some((score, view.color(point)?)));
    let best: Vec<(f32, Vec3)> = colors.take(PHOTOS + 1).collect();
    let least = if best.len() > PHOTOS { best[PHOTOS].0 } else { 0.0 };
    let weighted = best.iter().map(|&(score, color)| (color * (score - least)).extend(score - least));
    let sum: Vec4 = weighted.sum();
    (sum.w > 0.0).then(|| sum.truncate() / sum.w)
}

fn bytes(color: Vec3) -> [u8; 3] {
    (color.clamp(Vec3::ZERO, Vec3::ONE) * 255.0 + 0.5).to_array().map(|v| v as u8)
}

/// What the colours of texels are made of.
pub struct Baker<'a> {
    mesh: &'a Mesh,
    views: &'a [View<'a>],
    candidates: &'a [Vec<Candidate>],
    /// What is added at each vertex.
    levels: Vec<Vec3>,
}

impl<'a> Baker<'a> {
    pub fn new(mesh: &'a Mesh, views: &'a [View], candidates: &'a [Vec<Candidate>]) -> Self {
        Self { mesh, views, candidates, levels: levels(mesh, views, candidates) }
    }
}

/// What the photos lack at each vertex of the colours that all views together give it, smoothed over the vertices around: photos
/// that differ in their light meet at the same level.
fn levels(mesh: &Mesh, views: &[View], candidates: &[Vec<Candidate>]) -> Vec<Vec3> {
    let mut triangle_of = vec![u32::MAX; mesh.positions.len()];
    for (index, triangle) in (0..).zip(&mesh.triangles) {
        triangle.iter().for_each(|&vertex| triangle_of[vertex as usize] = index);
    }
    let difference = |vertex: usize| {
        let Some(candidates) = candidates.get(triangle_of[vertex] as usize) else { return Vec4::ZERO };
        let own = Vec3::from(mesh.colors[vertex].map(f32::from)) / 255.0;
        let photos = color(views, candidates, mesh.positions[vertex].into(), mesh.normals[vertex].into());
        photos.map_or(Vec4::ZERO, |color| (own - color).extend(1.0))
    };
    let mut sums: Vec<Vec4> = (0..mesh.positions.len()).into_par_iter().map(difference).collect();
    for _ in 0..SMOOTHINGS {
        let mut next = sums.clone();
        for triangle in &mesh.triangles {
            let around: Vec4 = triangle.iter().map(|&i| sums[i as usize]).sum();
            triangle.iter().for_each(|&i| next[i as usize] += around);
        }
        // Weights stay near 1.
        sums = next.into_iter().map(|sum| sum / sum.w.max(1.0)).collect();
    }
    sums.into_iter().map(|sum| if sum.w > 0.0 { sum.truncate() / sum.w } else { Vec3::ZERO }).collect()
}

/// Bakes a chart at a scale.
pub fn bake(baker: &Baker, chart: &Chart, scale: f32) -> Baked {
    let Baker { mesh, views, candidates, levels } = baker;
    let size = extent(chart.size, scale);
    let mut texels: Vec<Option<[u8; 3]>> = vec![None; size.element_product() as usize];
    let mut seen = 0;
    let shade = |triangle: u32, weights: Vec3| {
        let vertices = mesh.triangles[triangle as usize].map(|i| i as usize);
        let mean = |values: [Vec3; 3]| values[0] * weights.x + values[1] * weights.y + values[2] * weights.z;
        let point = mean(vertices.map(|i| mesh.positions[i].into()));
        let normal = mean(vertices.map(|i| mesh.normals[i].into())).normalize_or_zero();
        let own = || mean(vertices.map(|i| Vec3::from(mesh.colors[i].map(f32::from)) / 255.0));
        let level = || mean(vertices.map(|i| levels[i]));
        let photos = color(views, &candidates[triangle as usize], point, normal).map(|color| color + level());
        (bytes(photos.unwrap_or_else(own)), photos.is_some())
    };
    for (&triangle, corners) in chart.triangles.iter().zip(&chart.corners) {
        covered(corners.map(|corner| place(corner, scale)), |x, y, weights| {
            let (color, by_photos) = shade(triangle, weights);
            seen += usize::from(by_photos);
            texels[y as usize * size.x as usize + x as usize] = Some(color);
        });
    }
    let covered = texels.iter().flatten().count();
    if covered == 0 {
        let middle = place(chart.size / 2.0, scale).as_uvec2();
        let (color, _) = shade(chart.triangles[0], Vec3::splat(1.0 / 3.0));
        texels[(middle.y * size.x + middle.x) as usize] = Some(color);
    }
    Baked { size, rgb: spread(texels, size), covered, seen }
}

/// Texel coordinates of a corner in its chart.
pub fn place(corner: Vec2, scale: f32) -> Vec2 {
    corner * scale + PADDING as f32
}

/// Fills texels without a colour from those around them, as far as the padding goes, and what is left with the mean colour.
fn spread(mut texels: Vec<Option<[u8; 3]>>, size: UVec2) -> Vec<[u8; 3]> {
    let index = |at: IVec2| (at.y * size.x as i32 + at.x) as usize;
    let mut open: Vec<IVec2> = (0..texels.len() as i32)
        .map(|i| IVec2::new(i % size.x as i32, i / size.x as i32))
        .filter(|&at| texels[index(at)].is_none())
        .collect();
    for _ in 0..=PADDING {
        let mean = |&at: &IVec2| {
            let around = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| at + IVec2::new(dx, dy)));
            let inside = around.filter(|p| p.cmpge(IVec2::ZERO).all() && p.cmplt(size.as_ivec2()).all());
            let known = inside.filter_map(|p| texels[index(p)]).map(|c| Vec3::from(c.map(f32::from)).extend(1.0));
            let sum: Vec4 = known.sum();
            (sum.w > 0.0).then(|| bytes(sum.truncate() / (255.0 * sum.w)))
        };
        let found: Vec<Option<[u8; 3]>> = open.iter().map(mean).collect();
        open.iter().zip(&found).for_each(|(&at, color)| texels[index(at)] = *color);
        open.retain(|&at| texels[index(at)].is_none());
    }
    let known = texels.iter().flatten();
    let sum = known
        .fold([0_u64; 4], |[r, g, b, n], c| [r + u64::from(c[0]), g + u64::from(c[1]), b + u64::from(c[2]), n + 1]);
    let rest = [0, 1, 2].map(|i| (sum[i] / sum[3].max(1)) as u8);
    texels.into_iter().map(|texel| texel.unwrap_or(rest)).collect()
}
