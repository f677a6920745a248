//! What is done to a mesh before it is written: holes, number of triangles, texture.

use crate::commands::model::OpenModel;
use crate::progress::Bars;
use crate::stderr;
use anyhow::{Context, Result, bail};
use clap::Args as ClapArgs;
use ibgs_core::local_space::Length;
use ibgs_core::mesh::{
    Decimation, DepthMap, MOST_HOLE_EDGES, Mesh, MeshFormat, TextureOptions, TexturePhoto, TexturedMesh,
};
use std::path::Path;
use std::time::Instant;

/// Default of `--triangles` with a texture, which has the detail that vertices need not have then.
const TEXTURED_TRIANGLES: usize = 200_000;
/// Default of `--fill-holes` with a texture.
const TEXTURED_HOLES: usize = 30;
/// Options of the finished mesh.
#[derive(ClapArgs)]
#[command(next_help_heading = "Triangles and texture")]
pub struct Options {
    /// Decimate the mesh to this many triangles [default: all; with `--texture` 200000, unless `--max-error` is given].
    #[arg(long)]
    triangles: Option<usize>,
    /// Decimate the mesh while its surface moves by no more than about this (root mean square), in scene units, or until
    /// `--triangles` are left.
    #[arg(long)]
    max_error: Option<f64>,
    /// Close holes with up to this many edges; 0: none [default: 0; with `--texture` 30].
    #[arg(long)]
    fill_holes: Option<usize>,
    /// Give the mesh a texture from the training photos, in a `.glb`, or beside an `.obj` as `.mtl` and `.png`.
    #[arg(long)]
    pub texture: bool,
    /// Width and height of the texture at most, in texels.
    #[arg(long, default_value_t = 4096, requires = "texture", value_parser = clap::value_parser!(u32).range(64..=16384))]
    texture_size: u32,
}

impl Options {
    /// Checks the options and the name of the file.
    pub fn check(&self, output: Option<&Path>) -> Result<()> {
        self.decimation().check()?;
        if let Some(edges) = self.fill_holes.filter(|&edges| edges > MOST_HOLE_EDGES) {
            bail!("`--fill-holes` is {edges}; choose at most {MOST_HOLE_EDGES}");
        }
        match output {
            Some(output) if self.texture => drop(MeshFormat::of_textured(output)?),
            Some(output) => drop(MeshFormat::of(output)?),
            None => {}
        }
        Ok(())
    }

    fn decimation(&self) -> Decimation {
        let usual = (self.texture && self.max_error.is_none()).then_some(TEXTURED_TRIANGLES);
        Decimation { triangles: self.triangles.or(usual), max_error: self.max_error }
    }

    /// The photos for the texture; none without one.
    pub fn photos(&self, model: &mut OpenModel) -> Result<Option<Vec<TexturePhoto>>> {
        if !self.texture {
            return Ok(None);
        }
        let photos = model.load_training_photos(&Bars::default())?;
        let field = model.exposure_field()?;
        let exposure = |index: usize| field.as_ref().map_or_else(Default::default, |field| field.photos()[index]);
        let photo = |(index, photo): (usize, &ibgs_core::dataset::HostPhoto)| {
            Ok(TexturePhoto { photo: photo.pixels()?, exposure: exposure(index) })
        };
        photos
            .iter()
            .enumerate()
            .map(photo)
            .collect::<Result<_>>()
            .context("the texture needs all training photos")
            .map(Some)
    }

    /// Closes holes and decimates; returns how far that moves the surface.
    pub fn reduce(&self, mesh: &mut Mesh) -> Result<f64> {
        let edges = self.fill_holes.unwrap_or(if self.texture { TEXTURED_HOLES } else { 0 });
        if edges > 0 {
            let filled = mesh.fill_holes(edges);
            stderr!("{filled} holes of up to {edges} edges closed");
        }
        let before = mesh.triangles.len();
        let error = mesh.simplify(&self.decimation())?;
        if mesh.triangles.len() < before {
            let after = mesh.triangles.len();
            stderr!("decimated from {before} to {after} triangles, which moves the surface by about {}", Length(error));
        }
        Ok(error)
    }

    /// The mesh with its texture. `off` is how far its surface may be from that of the depth maps.
    pub fn textured(&self, mesh: &Mesh, maps: &[DepthMap], photos: &[TexturePhoto], off: f64) -> Result<TexturedMesh> {
        let start = Instant::now();
        let options = TextureOptions { size: self.texture_size, tolerance: off };
        let textured = TexturedMesh::new(mesh, maps, photos, &options, &Bars::default())?;
        let side = textured.image.width;
        stderr!(
            "texture of {side} x {side} in {:.1} s: {} charts at {:.0} % of the photos' resolution, {:.1} % of it from photos",
            start.elapsed().as_secs_f64(),
            textured.charts,
            100.0 * textured.scale,
            100.0 * textured.seen
        );
        Ok(textured)
    }
}
