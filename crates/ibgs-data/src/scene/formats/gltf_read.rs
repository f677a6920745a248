//! Reading of glTF, binary or as text, see [`super::gltf`]. A primitive may hold an SPZ file in place of its attributes
//! (`KHR_gaussian_splatting_compression_spz_2`, a draft of 2026).

use super::super::Gaussians;
use super::super::gaussians::coefficients;
use super::gltf::{EXTENSION, FLOAT, harmonic};
use super::gltf_buffers::{Buffer, Buffers};
use super::gltf_colors::ColorSpace;
use super::gltf_nodes::{Node, Pose, meshes};
use super::{MAX_SH_DEGREE, axes, quantise, spz_read};
use serde::Deserialize;
use serde_json::Value;
use std::collections::HashMap;
use std::path::Path;

/// Bytes of the file for each Gaussian, at the least; beyond it nodes repeat their meshes too often.
const LEAST_BYTES: usize = 16;
/// How often nodes may repeat the bytes of SPZ files.
const MOST_REPEATS: usize = 4;
/// Extensions of the extension with an SPZ file; the second is the name of an older draft.
const SPZ: [&str; 2] = ["KHR_gaussian_splatting_compression_spz_2", "KHR_gaussian_splatting_compression_spz"];

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Document {
    scene: Option<usize>,
    #[serde(default)]
    scenes: Vec<Scene>,
    #[serde(default)]
    nodes: Vec<Node>,
    #[serde(default)]
    meshes: Vec<Mesh>,
    #[serde(default)]
    accessors: Vec<Accessor>,
    #[serde(default)]
    buffer_views: Vec<View>,
    #[serde(default)]
    buffers: Vec<Buffer>,
}

#[derive(Deserialize)]
struct Scene {
    #[serde(default)]
    nodes: Vec<usize>,
}

#[derive(Deserialize)]
struct Mesh {
    primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
struct Primitive {
    attributes: HashMap<String, usize>,
    #[serde(default)]
    extensions: HashMap<String, Value>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Accessor {
    buffer_view: Option<usize>,
    #[serde(default)]
    byte_offset: usize,
    component_type: u32,
    #[serde(default)]
    normalized: bool,
    count: usize,
    #[serde(rename = "type")]
    kind: String,
    sparse: Option<Value>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct View {
    buffer: usize,
    #[serde(default)]
    byte_offset: usize,
    byte_length: usize,
    byte_stride: Option<usize>,
}

/// Reads a whole binary file: the Gaussians of all nodes of its scene. `path` is for files beside it and for what the log says.
///
/// # Errors
/// What is wrong.
pub(super) fn read(bytes: &[u8], path: &Path) -> Result<Gaussians, String> {
    let (text, binary) = chunks(bytes)?;
    read_described(text, binary, path)
}

/// Reads a description whose buffers lie in `binary`, in itself or in files beside `path`.
///
/// # Errors
/// What is wrong.
pub(super) fn read_described(text: &[u8], binary: &[u8], path: &Path) -> Result<Gaussians, String> {
    let mut document: Document =
        serde_json::from_slice(text).map_err(|error| format!("its description is wrong: {error}"))?;
    let buffers = Buffers::new(std::mem::take(&mut document.buffers), binary, path);
    let file = File { document, buffers };
    let primitives = file.primitives()?;
    if primitives.is_empty() {
        return Err(format!("it has no primitive with `{EXTENSION}`"));
    }
    ColorSpace::say(primitives.iter().map(|primitive| primitive.colors), path);
    let mut parts = Vec::with_capacity(primitives.len());
    let (mut count, mut packed) = (0, 0);
    for Part { primitive, spz, colors, pose } in primitives {
        let mut part = match spz {
            Some(view) => {
                let bytes = file.view(view)?;
                packed += bytes.len();
                let all = text.len() + file.buffers.bytes();
                if packed > MOST_REPEATS * all {
                    return Err("its nodes repeat its Gaussians too often".to_owned());
                }
                unpacked(bytes)?
            }
            None => {
                let part =
                    file.gaussians(primitive, |file| (text.len() + file.buffers.bytes()) / LEAST_BYTES - count)?;
                count += part.len();
                part
            }
        };
        colors.convert(&mut part);
        pose.apply(&mut part);
        parts.push(part);
    }
    Ok(Gaussians::joined(parts))
}

/// The Gaussians of an SPZ file, with the axes of glTF.
fn unpacked(bytes: &[u8]) -> Result<Gaussians, String> {
    let mut g = spz_read::read(bytes).map_err(|reason| format!("the SPZ file in it is wrong: {reason}"))?;
    // Both are signs against the axes of 3DGS.
    axes::turn(&mut g, axes::RUB);
    axes::turn(&mut g, axes::LUF);
    Ok(g)
}

/// The description and the binary chunk of a file.
fn chunks(bytes: &[u8]) -> Result<(&[u8], &[u8]), String> {
    let word = |at: usize| -> Result<usize, String> {
        let word = bytes.get(at..at + 4).and_then(|word| word.try_into().ok());
        word.map(|word| u32::from_le_bytes(word) as usize).ok_or_else(|| "it is truncated".to_owned())
    };
    match word(4)? {
        2 => {}
        other => return Err(format!("it has version {other} of glTF; version 2 is read")),
    }
    let mut found: [&[u8]; 2] = [&[]; 2];
    let mut at = 12;
    while at + 8 <= bytes.len() {
        let length = word(at)?;
        let chunk = bytes.get(at + 8..).and_then(|rest| rest.get(..length));
        let chunk = chunk.ok_or_else(|| "it is truncated: a chunk ends behind the file".to_owned())?;
        match &bytes[at + 4..at + 8] {
            b"JSON" => found[0] = chunk,
            b"BIN\0" => found[1] = chunk,
            _ => {}
        }
        at += 8 + length;
    }
    Ok((found[0], found[1]))
}

/// The degree of the coefficients that a primitive has.
fn sh_degree(primitive: &Primitive) -> u32 {
    let has = |degree: &u32| primitive.attributes.contains_key(&harmonic(coefficients(*degree) - 1));
    (0..=MAX_SH_DEGREE).take_while(has).last().unwrap_or_default()
}

/// A primitive with the extension, and where its node stands.
struct Part<'a> {
    primitive: &'a Primitive,
    /// The buffer view of its SPZ file.
    spz: Option<usize>,
    colors: ColorSpace,
    pose: Pose,
}

struct File<'a> {
    document: Document,
    buffers: Buffers<'a>,
}

impl File<'_> {
    /// Primitives with the extension.
    fn primitives(&self) -> Result<Vec<Part<'_>>, String> {
        let Document { scene, scenes, nodes, .. } = &self.document;
        let scene = scenes.get(scene.unwrap_or_default()).ok_or("it has no scene")?;
        let mut found = Vec::new();
        for (mesh, world) in meshes(nodes, &scene.nodes)? {
            let mesh = self.document.meshes.get(mesh).ok_or_else(|| format!("it has no mesh {mesh}"))?;
            for primitive in &mesh.primitives {
                let Some(extension) = primitive.extensions.get(EXTENSION) else { continue };
                let spz = check_extension(extension)?;
                found.push(Part { primitive, spz, colors: ColorSpace::of(extension)?, pose: Pose::of(world)? });
            }
        }
        Ok(found)
    }

    /// The Gaussians of a primitive in its own coordinates; `room` says how many there may be, once their positions are read.
    fn gaussians(&self, primitive: &Primitive, room: impl Fn(&Self) -> usize) -> Result<Gaussians, String> {
        let index = |name: &str| primitive.attributes.get(name).copied().ok_or_else(|| format!("it lacks `{name}`"));
        let count = self.accessor(index("POSITION")?)?.count;
        let means = self.values(index("POSITION")?, ("POSITION", "VEC3"), count)?;
        if count > room(self) {
            return Err("its nodes repeat its Gaussians too often".to_owned());
        }
        let values = |name: &str, kind: &str| self.values(index(name)?, (name, kind), count);
        let degree = sh_degree(primitive);
        let mut g = Gaussians::with_capacity(0, degree);
        g.means = triples(&means);
        let rotations = values(&format!("{EXTENSION}:ROTATION"), "VEC4")?;
        let quaternion = |q: &[f32]| quantise::read_quaternion(quantise::scalar_first([q[0], q[1], q[2], q[3]]));
        g.rotations = rotations.chunks_exact(4).map(quaternion).collect();
        let scales = values(&format!("{EXTENSION}:SCALE"), "VEC3")?;
        g.log_scales = triples(&scales.iter().map(|&v| quantise::log_scale(v)).collect::<Vec<_>>());
        let opacity = format!("{EXTENSION}:OPACITY");
        let step = match self.accessor(index(&opacity)?)?.component_type {
            5121 => 1.0 / 255.0,
            5123 => 1.0 / 65535.0,
            _ => quantise::FLOAT_STEP,
        };
        let logit = |v: &f32| quantise::logit(f64::from(*v), step);
        g.opacity_logits = values(&opacity, "SCALAR")?.iter().map(logit).collect();
        let all = coefficients(degree);
        g.sh = vec![0.0; 3 * all * count];
        for coefficient in 0..all {
            let rgb = values(&harmonic(coefficient), "VEC3")?;
            for (row, rgb) in g.sh.chunks_exact_mut(3 * all).zip(rgb.chunks_exact(3)) {
                row[3 * coefficient..3 * coefficient + 3].copy_from_slice(rgb);
            }
        }
        Ok(g)
    }

    fn accessor(&self, index: usize) -> Result<&Accessor, String> {
        self.document.accessors.get(index).ok_or_else(|| format!("it has no accessor {index}"))
    }

    /// The numbers of an attribute with a name, of a type: `count` rows of them.
    /// The bytes of a buffer view.
    fn view(&self, index: usize) -> Result<&[u8], String> {
        let view = self.document.buffer_views.get(index).ok_or_else(|| format!("it has no buffer view {index}"))?;
        let buffer = self.buffers.get(view.buffer)?;
        let data = buffer.get(view.byte_offset..).and_then(|rest| rest.get(..view.byte_length));
        data.ok_or_else(|| format!("its buffer view {index} reaches behind the end of its buffer"))
    }

    fn values(&self, index: usize, (name, kind): (&str, &str), count: usize) -> Result<Vec<f32>, String> {
        let accessor = self.accessor(index)?;
        let wrong = |what: String| format!("its attribute `{name}` {what}");
        if accessor.kind != kind || accessor.count != count {
            return Err(wrong(format!("has {} x {} where {count} x {kind} are needed", accessor.count, accessor.kind)));
        }
        if accessor.sparse.is_some() {
            return Err(wrong("is sparse, which is not read".to_owned()));
        }
        let columns = match kind {
            "SCALAR" => 1,
            "VEC3" => 3,
            _ => 4,
        };
        let (size, number) =
            component(accessor).ok_or_else(|| wrong("has a component type of no number".to_owned()))?;
        let view = accessor.buffer_view.ok_or_else(|| wrong("has no buffer view".to_owned()))?;
        let data = self.view(view).map_err(|reason| format!("{reason} (its attribute `{name}`)"))?;
        let stride = self.document.buffer_views[view].byte_stride.filter(|&stride| stride > 0);
        let stride = stride.unwrap_or(size * columns);
        let data = data.get(accessor.byte_offset..);
        let needed = count.checked_sub(1).and_then(|steps| steps.checked_mul(stride)?.checked_add(size * columns));
        let data = data.filter(|data| data.len() >= needed.unwrap_or(0));
        let data = data.ok_or_else(|| wrong("reaches behind the end of the file".to_owned()))?;
        let row = |index: usize| data[index * stride..][..size * columns].chunks_exact(size).map(number);
        Ok((0..count).flat_map(row).collect())
    }
}

/// Refuses what is not the kernel of 3DGS. Gives the buffer view of the SPZ file that holds the Gaussians, if one does.
fn check_extension(extension: &Value) -> Result<Option<usize>, String> {
    if let Some(kernel) = extension.get("kernel").and_then(Value::as_str).filter(|&kernel| kernel != "ellipse") {
        return Err(format!("its Gaussians have the kernel `{kernel}`; `ellipse` is read"));
    }
    let inner = extension.get("extensions").and_then(Value::as_object).and_then(|inner| inner.iter().next());
    let Some((name, inner)) = inner else { return Ok(None) };
    if !SPZ.contains(&name.as_str()) {
        return Err(format!("its Gaussians need the extension `{}`, which is not read", name.escape_debug()));
    }
    let view = inner.get("bufferView").and_then(Value::as_u64).and_then(|view| usize::try_from(view).ok());
    view.map(Some).ok_or_else(|| format!("its extension `{name}` names no `bufferView`"))
}

/// The number in the bytes of a component.
type Number = fn(&[u8]) -> f32;

/// Bytes of a component, and how it becomes a number.
fn component(accessor: &Accessor) -> Option<(usize, Number)> {
    Some(match (accessor.component_type, accessor.normalized) {
        (FLOAT, _) => (4, |b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])),
        (5120, true) => (1, |b| (f32::from(b[0] as i8) / 127.0).max(-1.0)),
        (5120, false) => (1, |b| f32::from(b[0] as i8)),
        (5121, true) => (1, |b| f32::from(b[0]) / 255.0),
        (5122, true) => (2, |b| (f32::from(i16::from_le_bytes([b[0], b[1]])) / 32767.0).max(-1.0)),
        (5122, false) => (2, |b| f32::from(i16::from_le_bytes([b[0], b[1]]))),
        (5123, true) => (2, |b| f32::from(u16::from_le_bytes([b[0], b[1]])) / 65535.0),
        _ => return None,
    })
}

fn triples(values: &[f32]) -> Vec<[f32; 3]> {
    values.chunks_exact(3).map(|v| [v[0], v[1], v[2]]).collect()
}
