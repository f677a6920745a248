//! Meshes as binary glTF 2.0. Colours of vertices are in linear light as the format wants them; a texture replaces them, with a
//! material that no light changes, as the photos have theirs.

use super::Mesh;
use super::write::{Texture, write_floats, write_indices};
use glam::DVec3;
use serde_json::{Value, json};
use std::io::{self, Write};

const FLOAT: u32 = 5126;
const SHORT: u32 = 5123;
const INT: u32 = 5125;
/// What a buffer view is for: vertices, indices.
const VERTICES: u32 = 34962;
const INDICES: u32 = 34963;
/// The extension for materials without light.
const UNLIT: &str = "KHR_materials_unlit";

/// A mesh to be written.
pub(super) struct Glb<'a> {
    pub mesh: &'a Mesh,
    pub texture: Option<Texture<'a>>,
}

impl Glb<'_> {
    /// Positions, normals, colours (16 bits a channel, padded to four) or texture coordinates, indices, the texture.
    fn buffer(&self) -> u64 {
        let png = self.texture.map_or(0, |texture| texture.png.len().next_multiple_of(4));
        (12 + 12 + 8) * self.mesh.positions.len() as u64 + 12 * self.mesh.triangles.len() as u64 + png as u64
    }

    /// Bytes of the file, with room for its description.
    pub fn bytes(&self) -> u64 {
        self.buffer() + 4096
    }

    pub fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        let mut text = self.description().to_string();
        // Chunks are whole words.
        text.push_str(&" ".repeat(text.len().next_multiple_of(4) - text.len()));
        let (text, buffer) = (text.into_bytes(), self.buffer() as u32);
        let total = 12 + 8 + text.len() as u32 + 8 + buffer;
        out.write_all(b"glTF")?;
        write_indices(out, &[2, total])?;
        write_indices(out, &[text.len() as u32])?;
        out.write_all(b"JSON")?;
        out.write_all(&text)?;
        write_indices(out, &[buffer])?;
        out.write_all(b"BIN\0")?;
        let mesh = self.mesh;
        mesh.positions.iter().chain(&mesh.normals).try_for_each(|values| write_floats(out, values))?;
        match self.texture {
            Some(texture) => texture.uvs.iter().try_for_each(|uv| write_floats(out, uv))?,
            None => mesh.colors.iter().try_for_each(|&color| write_color(out, color))?,
        }
        mesh.triangles.iter().try_for_each(|triangle| write_indices(out, triangle))?;
        if let Some(Texture { png, .. }) = self.texture {
            out.write_all(png)?;
            out.write_all(&[0; 3][..png.len().next_multiple_of(4) - png.len()])?;
        }
        Ok(())
    }

    fn description(&self) -> Value {
        let mesh = self.mesh;
        let (vertices, indices) = (mesh.positions.len(), 3 * mesh.triangles.len());
        let mut first = 0;
        let mut view = |bytes: usize, target: Option<u32>| {
            let mut view = json!({"buffer": 0, "byteOffset": first, "byteLength": bytes});
            if let Some(target) = target {
                view["target"] = json!(target);
            }
            first += bytes;
            view
        };
        let sizes =
            [(12 * vertices, VERTICES), (12 * vertices, VERTICES), (8 * vertices, VERTICES), (4 * indices, INDICES)];
        let mut views = sizes.map(|(bytes, target)| view(bytes, Some(target))).to_vec();
        views.extend(self.texture.map(|texture| view(texture.png.len(), None)));
        let mut node = json!({"mesh": 0});
        if mesh.offset != DVec3::ZERO {
            node["translation"] = json!(mesh.offset.to_array());
        }
        let mut whole = json!({
            "asset": {"version": "2.0", "generator": "ibgs"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [node],
            "meshes": [{"primitives": [{
                "attributes": {"POSITION": 0, "NORMAL": 1, self.attribute(): 2}, "indices": 3, "material": 0, "mode": 4,
            }]}],
            "materials": [{"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0}}],
            "accessors": self.accessors(),
            "bufferViews": views,
            "buffers": [{"byteLength": self.buffer()}],
        });
        if self.texture.is_some() {
            whole["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = json!({"index": 0});
            whole["materials"][0]["extensions"] = json!({UNLIT: {}});
            whole["extensionsUsed"] = json!([UNLIT]);
            whole["textures"] = json!([{"source": 0, "sampler": 0}]);
            // Linear, with reduced copies; clamped to the edge.
            whole["samplers"] = json!([{"magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071}]);
            whole["images"] = json!([{"bufferView": 4, "mimeType": "image/png"}]);
        }
        whole
    }

    /// What gives the vertices their colour.
    fn attribute(&self) -> &'static str {
        if self.texture.is_some() { "TEXCOORD_0" } else { "COLOR_0" }
    }

    fn accessors(&self) -> Value {
        let positions = &self.mesh.positions;
        let corner = |better: fn(f32, f32) -> f32| -> [f32; 3] {
            let first = positions.first().copied().unwrap_or_default();
            positions.iter().fold(first, |a, b| std::array::from_fn(|i| better(a[i], b[i])))
        };
        let vertices = positions.len();
        let third = match self.texture {
            Some(_) => json!({"bufferView": 2, "componentType": FLOAT, "count": vertices, "type": "VEC2"}),
            None => {
                json!({"bufferView": 2, "componentType": SHORT, "normalized": true, "count": vertices, "type": "VEC4"})
            }
        };
        json!([
            {"bufferView": 0, "componentType": FLOAT, "count": vertices, "type": "VEC3",
             "min": corner(f32::min), "max": corner(f32::max)},
            {"bufferView": 1, "componentType": FLOAT, "count": vertices, "type": "VEC3"},
            third,
            {"bufferView": 3, "componentType": INT, "count": 3 * self.mesh.triangles.len(), "type": "SCALAR"},
        ])
    }
}

fn write_color(out: &mut dyn Write, color: [u8; 3]) -> io::Result<()> {
    color.map(linear).into_iter().chain([u16::MAX]).try_for_each(|value| out.write_all(&value.to_le_bytes()))
}

/// An sRGB byte in linear light, 16 bits.
fn linear(byte: u8) -> u16 {
    let v = f32::from(byte) / 255.0;
    let linear = if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) };
    (linear * 65535.0 + 0.5) as u16
}
