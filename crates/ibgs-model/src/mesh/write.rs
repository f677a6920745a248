//! Mesh files: PLY, OBJ and binary glTF, in scene units. A mesh far from the scene's origin has an offset: PLY gives it in its
//! header, glTF in its node, and OBJ, which is text, has whole coordinates. A texture lies in the glTF, and beside the OBJ.

use super::glb::Glb;
use super::{Mesh, MeshError, TexturedMesh};
use crate::files;
use glam::DVec3;
use ibgs_data::ply_offset;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use std::fs::File;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

/// How the material file of an OBJ begins.
const MATERIAL_MARK: &str = "# ibgs\n";

/// Format of a mesh file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshFormat {
    /// Binary little-endian PLY: position, normal, 8-bit colour.
    Ply,
    /// Wavefront OBJ, with colours after the positions as most programs read them.
    Obj,
    /// Binary glTF 2.0, colours in linear light as the format wants them.
    Glb,
}

impl MeshFormat {
    /// The format by the ending of a file's name.
    ///
    /// # Errors
    /// [`MeshError::Format`].
    pub fn of(path: &Path) -> Result<Self, MeshError> {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        match extension.as_str() {
            "ply" => Ok(Self::Ply),
            "obj" => Ok(Self::Obj),
            "glb" => Ok(Self::Glb),
            _ => Err(MeshError::Format { path: path.to_owned() }),
        }
    }

    /// The format of a file for a textured mesh, whose material and texture may be written beside it.
    ///
    /// # Errors
    /// [`MeshError::Format`], [`MeshError::Untextured`], [`MeshError::InTheWay`].
    pub fn of_textured(path: &Path) -> Result<Self, MeshError> {
        match Self::of(path)? {
            Self::Ply => Err(MeshError::Untextured { path: path.to_owned() }),
            Self::Glb => Ok(Self::Glb),
            Self::Obj => {
                let [material, texture] = beside(path);
                let mut mark = Vec::new();
                let read = File::open(&material).and_then(|file| file.take(7).read_to_end(&mut mark));
                let is_own = read.is_ok() && mark == MATERIAL_MARK.as_bytes();
                match [material, texture].into_iter().find(|path| !is_own && path.exists()) {
                    Some(path) => Err(MeshError::InTheWay { path }),
                    None => Ok(Self::Obj),
                }
            }
        }
    }
}

/// Material and texture of an OBJ.
fn beside(path: &Path) -> [PathBuf; 2] {
    ["mtl", "png"].map(|ending| path.with_extension(ending))
}

/// A texture that is written with a mesh.
#[derive(Clone, Copy)]
pub(super) struct Texture<'a> {
    /// Coordinates of the vertices, 0 to 1 to the right and down.
    pub uvs: &'a [[f32; 2]],
    /// The image as a PNG.
    pub png: &'a [u8],
}

impl TexturedMesh {
    /// Writes the mesh with its texture as [`Mesh::write`] does; for an OBJ a material (`.mtl`) and the texture (`.png`) first.
    ///
    /// # Errors
    /// As [`Mesh::write`] and [`MeshFormat::of_textured`].
    pub fn write(&self, path: &Path) -> Result<(), MeshError> {
        let format = MeshFormat::of_textured(path)?;
        let mut png = Vec::new();
        let (width, height) = (self.image.width, self.image.height);
        let encoded = PngEncoder::new(&mut png).write_image(&self.image.rgb, width, height, ExtendedColorType::Rgb8);
        encoded.map_err(|error| files::WriteError::new(path, io::Error::other(error)))?;
        if format == MeshFormat::Obj {
            let [material, texture] = beside(path);
            files::write_atomically(&material, |out| {
                let name = texture.file_name().unwrap_or_default().to_string_lossy();
                write!(out, "{MATERIAL_MARK}newmtl texture\nKa 0 0 0\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {name}\n")
            })?;
            files::write_atomically(&texture, |out| out.write_all(&png))?;
        }
        self.mesh.write_as(format, Some(Texture { uvs: &self.uvs, png: &png }), path)
    }
}

impl Mesh {
    /// Writes the mesh in one atomic step, in the format of the name's ending.
    ///
    /// # Errors
    /// [`MeshError::Format`], [`MeshError::TooLarge`] (binary glTF ends at 4 GiB), [`MeshError::Write`].
    pub fn write(&self, path: &Path) -> Result<(), MeshError> {
        self.write_as(MeshFormat::of(path)?, None, path)
    }

    fn write_as(&self, format: MeshFormat, texture: Option<Texture>, path: &Path) -> Result<(), MeshError> {
        let glb = Glb { mesh: self, texture };
        if format == MeshFormat::Glb && glb.bytes() > u64::from(u32::MAX) {
            return Err(MeshError::TooLarge { path: path.to_owned(), triangles: self.triangles.len() });
        }
        files::write_atomically(path, |out| match (format, texture) {
            (MeshFormat::Ply, _) => self.write_ply(out),
            (MeshFormat::Obj, None) => self.write_obj(out),
            (MeshFormat::Obj, Some(texture)) => self.write_textured_obj(texture, path, out),
            (MeshFormat::Glb, _) => glb.write(out),
        })?;
        Ok(())
    }

    fn vertices(&self) -> impl Iterator<Item = (&[f32; 3], &[f32; 3], &[u8; 3])> {
        self.positions.iter().zip(&self.normals).zip(&self.colors).map(|((p, n), c)| (p, n, c))
    }

    fn write_ply(&self, out: &mut dyn Write) -> io::Result<()> {
        let offset = ply_offset::line(Some(self.offset).filter(|&offset| offset != DVec3::ZERO));
        write!(out, "ply\nformat binary_little_endian 1.0\n{offset}element vertex {}\n", self.positions.len())?;
        for name in ["x", "y", "z", "nx", "ny", "nz"] {
            writeln!(out, "property float {name}")?;
        }
        for name in ["red", "green", "blue"] {
            writeln!(out, "property uchar {name}")?;
        }
        write!(out, "element face {}\nproperty list uchar int vertex_indices\nend_header\n", self.triangles.len())?;
        for (position, normal, color) in self.vertices() {
            write_floats(out, position)?;
            write_floats(out, normal)?;
            out.write_all(color)?;
        }
        for triangle in &self.triangles {
            out.write_all(&[3])?;
            write_indices(out, triangle)?;
        }
        Ok(())
    }

    fn write_obj(&self, out: &mut dyn Write) -> io::Result<()> {
        for (p, n, c) in self.vertices() {
            let [r, g, b] = c.map(|v| f32::from(v) / 255.0);
            self.write_position(p, out)?;
            writeln!(out, " {r:.4} {g:.4} {b:.4}")?;
            writeln!(out, "vn {:.4} {:.4} {:.4}", n[0], n[1], n[2])?;
        }
        for [a, b, c] in self.triangles.iter().map(|t| t.map(|i| u64::from(i) + 1)) {
            writeln!(out, "f {a}//{a} {b}//{b} {c}//{c}")?;
        }
        Ok(())
    }

    fn write_textured_obj(&self, texture: Texture, path: &Path, out: &mut dyn Write) -> io::Result<()> {
        let [material, _] = beside(path);
        let name = material.file_name().unwrap_or_default().to_string_lossy();
        writeln!(out, "mtllib {name}\nusemtl texture")?;
        for ((p, n, _), [u, v]) in self.vertices().zip(texture.uvs) {
            self.write_position(p, out)?;
            // From the lower left corner.
            writeln!(out, "\nvt {u:.6} {:.6}", 1.0 - v)?;
            writeln!(out, "vn {:.4} {:.4} {:.4}", n[0], n[1], n[2])?;
        }
        for [a, b, c] in self.triangles.iter().map(|t| t.map(|i| u64::from(i) + 1)) {
            writeln!(out, "f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}")?;
        }
        Ok(())
    }

    fn write_position(&self, p: &[f32; 3], out: &mut dyn Write) -> io::Result<()> {
        match self.offset == DVec3::ZERO {
            true => write!(out, "v {} {} {}", p[0], p[1], p[2]),
            false => {
                let DVec3 { x, y, z } = self.offset + DVec3::from(p.map(f64::from));
                write!(out, "v {x} {y} {z}")
            }
        }
    }
}

pub(super) fn write_floats(out: &mut dyn Write, values: &[f32]) -> io::Result<()> {
    values.iter().try_for_each(|v| out.write_all(&v.to_le_bytes()))
}

pub(super) fn write_indices(out: &mut dyn Write, values: &[u32]) -> io::Result<()> {
    values.iter().try_for_each(|v| out.write_all(&v.to_le_bytes()))
}

#[cfg(test)]
mod tests;
