//! Mesh files: PLY, OBJ and binary glTF, in scene units. A mesh far from the scene's origin has an offset: PLY gives it in its
//! header, glTF in its node, and OBJ, which is text, has whole coordinates.

use super::{Mesh, MeshError};
use crate::files;
use crate::ply_offset;
use glam::DVec3;
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
}

impl Mesh {
    /// Writes the mesh in one atomic step, in the format of the name's ending.
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
            match self.offset == DVec3::ZERO {
                true => write!(out, "v {} {} {}", p[0], p[1], p[2])?,
                false => {
                    let DVec3 { x, y, z } = self.offset + DVec3::from(p.map(f64::from));
                    write!(out, "v {x} {y} {z}")?;
                }
            }
            writeln!(out, " {r:.4} {g:.4} {b:.4}")?;
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
        let mut node = json!({"mesh": 0});
        if self.offset != DVec3::ZERO {
            node["translation"] = json!(self.offset.to_array());
        }
        json!({
            "asset": {"version": "2.0", "generator": "ibgs"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [node],
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

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;
    use std::path::PathBuf;

    fn mesh() -> Mesh {
        let normals = vec![[0.0, 0.0, 1.0], [0.0, 0.6, 0.8], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]];
        let positions = vec![[0.5, -1.25, 3.0], [1.0, 0.0, 0.1], [0.0, 1e-7, -2.0], [7.0, 8.0, 9.0]];
        let colors = vec![[255, 0, 128], [1, 2, 3], [0, 0, 0], [255, 255, 255]];
        Mesh { offset: DVec3::ZERO, positions, normals, colors, triangles: vec![[0, 1, 2], [2, 1, 3]] }
    }

    /// The bytes that are written under a name.
    fn written(name: &str) -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        mesh().write(&path).unwrap();
        std::fs::read(path).unwrap()
    }

    #[derive(Deserialize)]
    struct Ply {
        vertex: Vec<Vertex>,
        face: Vec<Face>,
    }

    #[derive(Deserialize)]
    struct Vertex {
        x: f32,
        y: f32,
        z: f32,
        nx: f32,
        ny: f32,
        nz: f32,
        red: u8,
        green: u8,
        blue: u8,
    }

    #[derive(Deserialize)]
    struct Face {
        vertex_indices: Vec<u32>,
    }

    #[test]
    fn ply() {
        let bytes = written("a.PLY");
        let ply: Ply = serde_ply::from_bytes(&bytes).unwrap();
        let read = Mesh {
            offset: DVec3::ZERO,
            positions: ply.vertex.iter().map(|v| [v.x, v.y, v.z]).collect(),
            normals: ply.vertex.iter().map(|v| [v.nx, v.ny, v.nz]).collect(),
            colors: ply.vertex.iter().map(|v| [v.red, v.green, v.blue]).collect(),
            triangles: ply.face.iter().map(|face| face.vertex_indices.clone().try_into().unwrap()).collect(),
        };
        assert_eq!(read, mesh());
    }

    #[test]
    fn obj() {
        let text = String::from_utf8(written("a.obj")).unwrap();
        let mut read = Mesh::default();
        for line in text.lines() {
            let (kind, rest) = line.split_once(' ').unwrap();
            let words: Vec<&str> = rest.split(' ').collect();
            let numbers = || words.iter().map(|word| word.parse().unwrap()).collect::<Vec<f32>>();
            match kind {
                "v" => {
                    read.positions.push(numbers()[..3].try_into().unwrap());
                    read.colors.push([3, 4, 5].map(|i| (numbers()[i] * 255.0).round() as u8));
                }
                "vn" => read.normals.push(numbers().try_into().unwrap()),
                "f" => {
                    let corner = |word: &str| {
                        let (vertex, normal) = word.split_once("//").unwrap();
                        assert_eq!(vertex, normal);
                        vertex.parse::<u32>().unwrap() - 1
                    };
                    read.triangles.push([0, 1, 2].map(|i| corner(words[i])));
                }
                _ => panic!("{line}"),
            }
        }
        assert_eq!(read, mesh());
    }

    #[test]
    fn glb() {
        let bytes = written("a.glb");
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        assert_eq!((&bytes[..4], word(4), word(8) as usize), (&b"glTF"[..], 2, bytes.len()));
        let length = word(12) as usize;
        assert_eq!((&bytes[16..20], length % 4), (&b"JSON"[..], 0));
        let document: Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
        let buffer = &bytes[28 + length..];
        assert_eq!((&bytes[24 + length..28 + length], word(20 + length) as usize), (&b"BIN\0"[..], buffer.len()));
        assert_eq!(document["buffers"][0]["byteLength"], buffer.len());
        let primitive = &document["meshes"][0]["primitives"][0];
        let data = |accessor: &Value, size: usize| {
            let accessor = &document["accessors"][accessor.as_u64().unwrap() as usize];
            let view = &document["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
            let (first, count) =
                (view["byteOffset"].as_u64().unwrap() as usize, accessor["count"].as_u64().unwrap() as usize);
            assert_eq!(view["byteLength"], count * size);
            &buffer[first..first + count * size]
        };
        let floats =
            |name: &str| -> Vec<[f32; 3]> { bytemuck::pod_collect_to_vec(data(&primitive["attributes"][name], 12)) };
        assert_eq!((floats("POSITION"), floats("NORMAL")), (mesh().positions, mesh().normals));
        let indices: Vec<[u32; 3]> = bytemuck::pod_collect_to_vec(data(&primitive["indices"], 4));
        assert_eq!(indices, mesh().triangles);
        let colors: Vec<[u16; 4]> = bytemuck::pod_collect_to_vec(data(&primitive["attributes"]["COLOR_0"], 8));
        // Linear light: 128 of 255 is 21.6 %.
        assert_eq!((colors[0], colors[3]), ([65535, 0, 14146, 65535], [65535; 4]));
        assert_eq!(document["accessors"][0]["min"], json!([0.0, -1.25, -2.0]));
        assert_eq!(document["accessors"][0]["max"], json!([7.0, 8.0, 9.0]));
    }

    #[test]
    fn far_meshes_keep_their_place() {
        let far = Mesh { offset: DVec3::new(5_000_000.0, -4e6, 0.5), ..mesh() };
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str| {
            let path = folder.path().join(name);
            far.write(&path).unwrap();
            String::from_utf8_lossy(&std::fs::read(path).unwrap()).into_owned()
        };
        assert!(file("a.ply").contains("\ncomment offset 5000000 -4000000 0.5\nelement vertex 4\n"));
        assert!(file("a.obj").starts_with("v 5000000.5 -4000001.25 3.5 "));
        assert!(file("a.glb").contains("\"translation\":[5000000.0,-4000000.0,0.5]"));
    }

    #[test]
    fn names_that_tell_no_format() {
        for name in ["a.stl", "a", "ply"] {
            let error = mesh().write(&PathBuf::from("nowhere").join(name)).unwrap_err().to_string();
            assert!(error.contains(name) && error.contains("must end in `.ply`, `.obj` or `.glb`"), "{error}");
        }
        assert!(!PathBuf::from("nowhere").exists());
    }
}
