//! Mesh files: PLY, OBJ and binary glTF.

use super::{Mesh, MeshError};
use crate::files;
use serde_json::{Value, json};
use std::io::{self, Write};
use std::path::Path;

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
    /// The format that a file's name tells.
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
}

impl Mesh {
    /// Writes the mesh in one atomic step, in the format that the name tells.
    ///
    /// # Errors
    /// [`MeshError::Format`], [`MeshError::TooLarge`] (binary glTF ends at 4 GiB), [`MeshError::Write`].
    pub fn write(&self, path: &Path) -> Result<(), MeshError> {
        let format = MeshFormat::of(path)?;
        if format == MeshFormat::Glb && self.glb_bytes() > u64::from(u32::MAX) {
            return Err(MeshError::TooLarge { path: path.to_owned(), triangles: self.triangles.len() });
        }
        files::write_atomically(path, |out| match format {
            MeshFormat::Ply => self.write_ply(out),
            MeshFormat::Obj => self.write_obj(out),
            MeshFormat::Glb => self.write_glb(out),
        })?;
        Ok(())
    }

    fn vertices(&self) -> impl Iterator<Item = (&[f32; 3], &[f32; 3], &[u8; 3])> {
        self.positions.iter().zip(&self.normals).zip(&self.colors).map(|((p, n), c)| (p, n, c))
    }

    fn write_ply(&self, out: &mut dyn Write) -> io::Result<()> {
        write!(out, "ply\nformat binary_little_endian 1.0\nelement vertex {}\n", self.positions.len())?;
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
            writeln!(out, "v {} {} {} {r:.4} {g:.4} {b:.4}", p[0], p[1], p[2])?;
            writeln!(out, "vn {:.4} {:.4} {:.4}", n[0], n[1], n[2])?;
        }
        for [a, b, c] in self.triangles.iter().map(|t| t.map(|i| u64::from(i) + 1)) {
            writeln!(out, "f {a}//{a} {b}//{b} {c}//{c}")?;
        }
        Ok(())
    }

    /// Positions, normals, colours (16 bits a channel, padded to four) and indices.
    fn glb_buffer(&self) -> u64 {
        (12 + 12 + 8) * self.positions.len() as u64 + 12 * self.triangles.len() as u64
    }

    /// Bytes of the file, with room for its description.
    fn glb_bytes(&self) -> u64 {
        self.glb_buffer() + 4096
    }

    fn write_glb(&self, out: &mut dyn Write) -> io::Result<()> {
        let mut text = self.glb_description().to_string();
        // Chunks are whole words.
        text.push_str(&" ".repeat(text.len().next_multiple_of(4) - text.len()));
        let (text, buffer) = (text.into_bytes(), self.glb_buffer() as u32);
        let total = 12 + 8 + text.len() as u32 + 8 + buffer;
        out.write_all(b"glTF")?;
        write_indices(out, &[2, total])?;
        write_indices(out, &[text.len() as u32])?;
        out.write_all(b"JSON")?;
        out.write_all(&text)?;
        write_indices(out, &[buffer])?;
        out.write_all(b"BIN\0")?;
        for position in &self.positions {
            write_floats(out, position)?;
        }
        for normal in &self.normals {
            write_floats(out, normal)?;
        }
        for color in &self.colors {
            for value in color.map(linear).into_iter().chain([u16::MAX]) {
                out.write_all(&value.to_le_bytes())?;
            }
        }
        self.triangles.iter().try_for_each(|triangle| write_indices(out, triangle))
    }

    fn glb_description(&self) -> Value {
        let [float, short, int] = [5126, 5123, 5125];
        let (vertices, indices) = (self.positions.len(), 3 * self.triangles.len());
        let mut first = 0;
        let mut view = |bytes: usize, target: u32| {
            let view = json!({"buffer": 0, "byteOffset": first, "byteLength": bytes, "target": target});
            first += bytes;
            view
        };
        let views = json!([
            view(12 * vertices, 34962),
            view(12 * vertices, 34962),
            view(8 * vertices, 34962),
            view(4 * indices, 34963)
        ]);
        let corner = |better: fn(f32, f32) -> f32| -> [f32; 3] {
            let first = self.positions.first().copied().unwrap_or_default();
            self.positions.iter().fold(first, |a, b| std::array::from_fn(|i| better(a[i], b[i])))
        };
        json!({
            "asset": {"version": "2.0", "generator": "ibgs"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{
                "attributes": {"POSITION": 0, "NORMAL": 1, "COLOR_0": 2}, "indices": 3, "material": 0, "mode": 4,
            }]}],
            "materials": [{"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0}}],
            "accessors": [
                {"bufferView": 0, "componentType": float, "count": vertices, "type": "VEC3",
                 "min": corner(f32::min), "max": corner(f32::max)},
                {"bufferView": 1, "componentType": float, "count": vertices, "type": "VEC3"},
                {"bufferView": 2, "componentType": short, "normalized": true, "count": vertices, "type": "VEC4"},
                {"bufferView": 3, "componentType": int, "count": indices, "type": "SCALAR"},
            ],
            "bufferViews": views,
            "buffers": [{"byteLength": self.glb_buffer()}],
        })
    }
}

/// An sRGB byte in linear light, 16 bits.
fn linear(byte: u8) -> u16 {
    let v = f32::from(byte) / 255.0;
    let linear = if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) };
    (linear * 65535.0 + 0.5) as u16
}

fn write_floats(out: &mut dyn Write, values: &[f32]) -> io::Result<()> {
    values.iter().try_for_each(|v| out.write_all(&v.to_le_bytes()))
}

fn write_indices(out: &mut dyn Write, values: &[u32]) -> io::Result<()> {
    values.iter().try_for_each(|v| out.write_all(&v.to_le_bytes()))
}
