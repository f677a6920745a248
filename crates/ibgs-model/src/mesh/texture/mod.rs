//! A texture for a mesh, from the photos.
//!
//! 1. A [`View`] knows whether a photo shows a point, by its depth map, and in which colour.
//! 2. [`Labels`] chooses a photo for each triangle, the same for large patches.
//! 3. [`charts`] lays connected triangles of one photo out as they lie in it, the rest along the axes.
//! 4. [`Atlas`] packs the charts.
//! 5. [`bake()`] gives each texel the mean of the best photos that see it, or the colour of the vertices.

mod atlas;
mod bake;
mod charts;
mod labels;
mod texels;
mod view;

use super::{DepthMap, Mesh, MeshError};
use crate::dataset::Photo;
use crate::exposure::Exposure;
use crate::picture::Picture;
use crate::progress::Progress;
use atlas::Atlas;
use bake::{Baker, bake, place};
use charts::charts;
use labels::{Labels, candidates, neighbours};
use rayon::prelude::*;
use std::sync::Arc;
use view::View;

/// A training photo.
#[derive(Clone, Debug)]
pub struct TexturePhoto {
    /// Its pixels; those with an alpha under one half are not used.
    pub photo: Arc<Photo>,
    /// Its exposure, which is taken away.
    pub exposure: Exposure,
}

/// How a texture is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureOptions {
    /// Width and height of the texture at most, in texels.
    pub size: u32,
    /// Distance in scene units between the mesh and the surface in a depth map up to which they are the same.
    pub tolerance: f64,
}

/// A mesh with a texture.
#[derive(Clone, Debug)]
pub struct TexturedMesh {
    /// The mesh; a vertex is there once for each chart.
    pub mesh: Mesh,
    /// Texture coordinates of the vertices, 0 to 1 to the right and down.
    pub uvs: Vec<[f32; 2]>,
    /// The texture.
    pub image: Picture,
    /// Number of charts.
    pub charts: usize,
    /// Texels for a pixel of the photos, along a side.
    pub scale: f32,
    /// Part of the texels that photos give.
    pub seen: f64,
}

impl TexturedMesh {
    /// Makes a texture from the photos of the views, whose depth maps are given in the same order. `progress` counts charts.
    ///
    /// # Errors
    /// [`MeshError::Option`] where the texture is too small for the mesh.
    ///
    /// # Panics
    /// When there are not as many photos as depth maps: a bug of ours.
    pub fn new(
        mesh: &Mesh,
        maps: &[DepthMap],
        photos: &[TexturePhoto],
        options: &TextureOptions,
        progress: &dyn Progress,
    ) -> Result<Self, MeshError> {
        assert_eq!(maps.len(), photos.len(), "a photo for every depth map");
        let view = |(map, photo)| View::new(map, photo, mesh.offset, options.tolerance);
        let views: Vec<View> = maps.iter().zip(photos).map(view).collect();
        let seen_by = candidates(mesh, &views);
        let beyond = neighbours(&mesh.triangles);
        let density = |triangle: u32, view: u32| {
            let vertices = mesh.triangles[triangle as usize];
            let normal = mesh.area(vertices).normalize_or_zero();
            views[view as usize].even_density(vertices.map(|i| mesh.positions[i as usize].into()), normal)
        };
        let labels = Labels { candidates: &seen_by, neighbours: &beyond, density: &density }.find(views.len());
        let charts = charts(mesh, &views, &labels, &seen_by, &beyond);
        let sizes: Vec<_> = charts.iter().map(|chart| chart.size).collect();
        let atlas = Atlas::of(&sizes, options.size)?;
        let baker = Baker::new(mesh, &views, &seen_by);
        progress.begin("baking", charts.len());
        let baked = charts.par_iter().map(|chart| {
            let baked = bake(&baker, chart, atlas.scale);
            progress.step();
            baked
        });
        let baked: Vec<_> = baked.collect();
        let count = |of: fn(&bake::Baked) -> usize| baked.iter().map(of).sum::<usize>() as f64;
        let seen = count(|baked| baked.seen) / count(|baked| baked.covered).max(1.0);
        let image = picture(&baked, &atlas);
        let mut textured =
            Self { mesh: Mesh::default(), uvs: Vec::new(), image, charts: charts.len(), scale: atlas.scale, seen };
        textured.add_charts(mesh, &charts, &atlas);
        Ok(textured)
    }

    fn add_charts(&mut self, whole: &Mesh, charts: &[charts::Chart], atlas: &Atlas) {
        self.mesh.offset = whole.offset;
        for (chart, corner) in charts.iter().zip(&atlas.places) {
            let first = self.mesh.positions.len() as u32;
            let (vertices, triangles) = chart.vertices(whole);
            self.mesh.triangles.extend(triangles.iter().map(|triangle| triangle.map(|i| first + i)));
            for (vertex, at) in vertices {
                let vertex = vertex as usize;
                self.mesh.positions.push(whole.positions[vertex]);
                self.mesh.normals.push(whole.normals[vertex]);
                self.mesh.colors.push(whole.colors[vertex]);
                self.uvs.push(((place(at, atlas.scale) + corner.as_vec2()) / atlas.side as f32).to_array());
            }
        }
    }
}

/// The texture of the charts.
fn picture(baked: &[bake::Baked], atlas: &Atlas) -> Picture {
    let side = atlas.side as usize;
    let mut rgb = vec![0; 3 * side * side];
    for (baked, corner) in baked.iter().zip(&atlas.places) {
        for (row, texels) in (corner.y as usize..).zip(baked.rgb.chunks_exact(baked.size.x as usize)) {
            let first = 3 * (row * side + corner.x as usize);
            rgb[first..first + 3 * texels.len()].copy_from_slice(texels.as_flattened());
        }
    }
    Picture { width: atlas.side, height: atlas.side, rgb }
}

#[cfg(test)]
mod tests;
