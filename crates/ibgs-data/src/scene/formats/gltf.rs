//! Binary glTF 2.0 with the extension `KHR_gaussian_splatting` of 2026; writing.
//!
//! One point primitive with an attribute of floats for each parameter: quaternions as x, y, z, w, standard deviations and
//! opacities as they are, coefficients of the spherical harmonics with the Condon-Shortley phase as 3DGS has them, in sRGB.
//! Where the scene lies far from its origin, the node's translation says so.

use super::super::Gaussians;
use super::{MAX_SH_DEGREE, Writer, Writing, axes, gltf_read, quantise};
use glam::DVec3;
use serde_json::{Map, Value, json};
use std::io::{self, Write};

pub(super) const EXTENSION: &str = "KHR_gaussian_splatting";
pub(super) const ROW: super::Row = super::Row {
    name: "binary glTF 2.0 with `KHR_gaussian_splatting`",
    ending: ".glb",
    marks: &[b"glTF"],
    axes: axes::LUF,
    max_sh_degree: MAX_SH_DEGREE,
    steps: super::PLY.steps,
    position_step: None,
    keeps_antialiased: false,
    place_of_offset: Some("the translation of its node"),
    writing: Writing::By(writer),
    read: Some(gltf_read::read),
};

/// The same as text, with its buffers in it or beside it.
pub(super) const TEXT: super::Row = super::Row {
    name: "glTF 2.0 with `KHR_gaussian_splatting`, as text",
    ending: ".gltf",
    marks: &[],
    writing: Writing::Never,
    read: Some(|bytes, path| gltf_read::read_described(bytes, &[], path)),
    ..ROW
};

/// Component type of floats.
pub(super) const FLOAT: u32 = 5126;
/// For the description, beside the buffer.
const DESCRIPTION: u64 = 1 << 16;

/// Refuses what is longer than the lengths in the file can say.
///
/// # Errors
/// Why.
fn check(g: &Gaussians) -> Result<(), String> {
    match buffer_bytes(g) + DESCRIPTION > u64::from(u32::MAX) {
        true => Err(format!("a binary glTF file holds up to 4 GiB, {} Gaussians need more", g.len())),
        false => Ok(()),
    }
}

fn floats_each(g: &Gaussians) -> u64 {
    (3 + 4 + 3 + 1 + 3 * g.sh_coefficients()) as u64
}

fn buffer_bytes(g: &Gaussians) -> u64 {
    4 * floats_each(g) * g.len() as u64
}

/// The attribute of a coefficient, counted from 0 over all degrees.
pub(super) fn harmonic(coefficient: usize) -> String {
    let degree = coefficient.isqrt();
    format!("{EXTENSION}:SH_DEGREE_{degree}_COEF_{}", coefficient - degree * degree)
}

fn writer(gaussians: &Gaussians) -> Writer<'_> {
    check(gaussians)?;
    Ok(Box::new(move |out| write(gaussians, out)))
}

/// Writes all Gaussians.
fn write(g: &Gaussians, out: &mut dyn Write) -> io::Result<()> {
    let mut text = description(g).to_string();
    // Chunks are whole words.
    text.push_str(&" ".repeat(text.len().next_multiple_of(4) - text.len()));
    let buffer = buffer_bytes(g) as u32;
    out.write_all(b"glTF")?;
    for word in [2, 12 + 8 + text.len() as u32 + 8 + buffer, text.len() as u32] {
        out.write_all(&word.to_le_bytes())?;
    }
    out.write_all(b"JSON")?;
    out.write_all(text.as_bytes())?;
    out.write_all(&buffer.to_le_bytes())?;
    out.write_all(b"BIN\0")?;
    floats(out, g.means.as_flattened().iter().copied())?;
    let rotations = g.rotations.iter().flat_map(|&q| quantise::scalar_last(quantise::unit_quaternion(q)));
    floats(out, rotations.map(|v| v as f32))?;
    floats(out, g.log_scales.as_flattened().iter().map(|v| v.exp()))?;
    floats(out, g.opacity_logits.iter().map(|&logit| quantise::opacity(logit) as f32))?;
    let row = 3 * g.sh_coefficients();
    for coefficient in 0..g.sh_coefficients() {
        floats(out, g.sh.chunks_exact(row).flat_map(|sh| &sh[3 * coefficient..3 * coefficient + 3]).copied())?;
    }
    Ok(())
}

fn floats(out: &mut dyn Write, mut values: impl Iterator<Item = f32>) -> io::Result<()> {
    values.try_for_each(|v| out.write_all(&v.to_le_bytes()))
}

fn description(g: &Gaussians) -> Value {
    let count = g.len();
    let fold = |start: f32, choose: fn(f32, f32) -> f32| -> [f32; 3] {
        g.means.iter().fold([start; 3], |a, b| std::array::from_fn(|axis| choose(a[axis], b[axis])))
    };
    let mut parts = vec![
        ("POSITION".to_owned(), "VEC3", 12),
        (format!("{EXTENSION}:ROTATION"), "VEC4", 16),
        (format!("{EXTENSION}:SCALE"), "VEC3", 12),
        (format!("{EXTENSION}:OPACITY"), "SCALAR", 4),
    ];
    parts.extend((0..g.sh_coefficients()).map(|coefficient| (harmonic(coefficient), "VEC3", 12)));
    let (mut attributes, mut accessors, mut views, mut first) = (Map::new(), Vec::new(), Vec::new(), 0);
    for (name, kind, size) in parts {
        let length = size * count;
        views.push(json!({"buffer": 0, "byteOffset": first, "byteLength": length, "target": 34962}));
        first += length;
        let mut accessor = json!({"bufferView": accessors.len(), "componentType": FLOAT, "count": count, "type": kind});
        if accessors.is_empty() {
            accessor["min"] = json!(fold(f32::INFINITY, f32::min));
            accessor["max"] = json!(fold(f32::NEG_INFINITY, f32::max));
        }
        attributes.insert(name, json!(accessors.len()));
        accessors.push(accessor);
    }
    let mut node = json!({"mesh": 0});
    if g.space.origin != DVec3::ZERO {
        node["translation"] = json!(g.space.origin.to_array());
    }
    let extension = json!({
        "kernel": "ellipse", "colorSpace": "srgb_rec709_display", "sortingMethod": "cameraDistance",
        "projection": "perspective",
    });
    json!({
        "asset": {"version": "2.0", "generator": "ibgs"},
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [node],
        "meshes": [{"primitives": [{"attributes": attributes, "mode": 0, "extensions": {EXTENSION: extension}}]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": first}],
    })
}

#[cfg(test)]
mod tests {
    use crate::scene::formats::Format;
    use crate::scene::formats::tests::{in_order, random, round_trip, rounding, written};

    #[test]
    fn floats_are_kept() {
        for degree in 0..=3 {
            let g = random(300, degree, 20 + u64::from(degree));
            let back = round_trip(&g, Format::Gltf);
            assert_eq!((&back.means, &back.sh), (&g.means, &g.sh), "signs of the axes cancel to the bit");
            let e = in_order(&g, Format::Gltf);
            assert!(e.log_scale <= rounding(8.0) && e.rotation <= rounding(1.0) && e.opacity <= rounding(1.0), "{e:?}");
        }
    }

    /// x points left and y up.
    #[test]
    fn axes_are_those_of_the_format() {
        let mut g = random(1, 0, 50);
        g.means[0] = [0.5, 1.0, 2.0];
        let glb = written(&g, Format::Gltf);
        let binary = glb.len() - 4 * 14;
        assert_eq!(bytemuck::pod_collect_to_vec::<u8, f32>(&glb[binary..binary + 12]), [-0.5, -1.0, 2.0]);
    }
}
