//! OpenUSD's `ParticleField3DGaussianSplat` (OpenUSD 26.03, schema UsdVol) in a text layer; writing.
//!
//! One prim with an array for each parameter: quaternions as w, x, y, z, standard deviations and opacities as they are, and
//! the coefficients of the spherical harmonics of each Gaussian one after the other, as 3DGS has them. y points up. Where
//! the scene lies far from its origin, the prim is translated.

use super::super::Gaussians;
use super::{MAX_SH_DEGREE, Writer, Writing, axes, quantise, usda_read};
use glam::DVec3;
use std::fmt::Display;
use std::io::{self, Write};

pub(super) const PRIM: &str = "ParticleField3DGaussianSplat";
pub(super) const ROW: super::Row = super::Row {
    name: "OpenUSD text with `ParticleField3DGaussianSplat`",
    ending: ".usda",
    marks: &[b"#usd"],
    axes: axes::RUB,
    max_sh_degree: MAX_SH_DEGREE,
    steps: super::PLY.steps,
    position_step: None,
    keeps_antialiased: false,
    place_of_offset: Some("the `xformOp:translate` of its prim"),
    writing: Writing::By(writer),
    read: Some(|bytes, _| usda_read::read(bytes)),
};

fn writer(gaussians: &Gaussians) -> Writer<'_> {
    Ok(Box::new(move |out| write(gaussians, out)))
}

fn write(g: &Gaussians, out: &mut dyn Write) -> io::Result<()> {
    out.write_all(b"#usda 1.0\n(\n    defaultPrim = \"Gaussians\"\n    metersPerUnit = 1\n    upAxis = \"Y\"\n)\n\n")?;
    write!(out, "def {PRIM} \"Gaussians\"\n{{\n")?;
    array(out, "float3[] extent", extent(g).into_iter().map(tuple))?;
    array(out, "point3f[] positions", g.means.iter().copied().map(tuple))?;
    let quaternion = |&q: &[f32; 4]| tuple(quantise::unit_quaternion(q).map(|v| v as f32));
    array(out, "quatf[] orientations", g.rotations.iter().map(quaternion))?;
    array(out, "float3[] scales", g.log_scales.iter().map(|scales| tuple(scales.map(f32::exp))))?;
    let opacity = |&logit: &f32| format!("{:?}", quantise::opacity(logit) as f32);
    array(out, "float[] opacities", g.opacity_logits.iter().map(opacity))?;
    writeln!(out, "    uniform int radiance:sphericalHarmonicsDegree = {}", g.sh_degree)?;
    let colors = g.sh.as_chunks::<3>().0.iter().copied().map(tuple);
    array(out, "float3[] radiance:sphericalHarmonicsCoefficients", colors)?;
    out.write_all(b"    uniform token projectionModeHint = \"perspective\"\n")?;
    out.write_all(b"    uniform token sortingModeHint = \"cameraDistance\"\n")?;
    let DVec3 { x, y, z } = g.space.origin;
    if g.space.origin != DVec3::ZERO {
        writeln!(out, "    double3 xformOp:translate = ({x:?}, {y:?}, {z:?})")?;
        out.write_all(b"    uniform token[] xformOpOrder = [\"xformOp:translate\"]\n")?;
    }
    out.write_all(b"}\n")
}

/// A property with a list of values, one line.
fn array(out: &mut dyn Write, property: &str, values: impl Iterator<Item = impl Display>) -> io::Result<()> {
    write!(out, "    {property} = [")?;
    for (index, value) in values.enumerate() {
        write!(out, "{}{value}", if index == 0 { "" } else { ", " })?;
    }
    out.write_all(b"]\n")
}

/// With as many digits as the floats need.
fn tuple<const N: usize>(values: [f32; N]) -> String {
    format!("({})", values.map(|v| format!("{v:?}")).join(", "))
}

/// The box around three standard deviations of all Gaussians, wherever they point.
fn extent(g: &Gaussians) -> [[f32; 3]; 2] {
    let mut corners = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
    for (mean, scales) in g.means.iter().zip(&g.log_scales) {
        let reach = (3.0 * scales.iter().copied().fold(f32::NEG_INFINITY, f32::max).exp()).min(f32::MAX / 4.0);
        for (axis, v) in mean.iter().enumerate() {
            corners[0][axis] = corners[0][axis].min(v - reach).max(f32::MIN);
            corners[1][axis] = corners[1][axis].max(v + reach).min(f32::MAX);
        }
    }
    corners
}

#[cfg(test)]
mod tests {
    use crate::scene::formats::Format;
    use crate::scene::formats::tests::{in_order, random, round_trip, rounding, written};

    #[test]
    fn floats_are_kept() {
        for degree in 0..=3 {
            let g = random(300, degree, 90 + u64::from(degree));
            let back = round_trip(&g, Format::Usda);
            assert_eq!((&back.means, &back.sh), (&g.means, &g.sh), "to the bit");
            let e = in_order(&g, Format::Usda);
            assert!(e.log_scale <= rounding(8.0) && e.rotation <= rounding(1.0) && e.opacity <= rounding(1.0), "{e:?}");
        }
    }

    /// y points up and z back.
    #[test]
    fn axes_are_those_of_the_format() {
        let mut g = random(1, 0, 50);
        (g.means[0], g.log_scales[0]) = ([0.5, 1.0, 2e-9], [0.0, -1.0, -2.0]);
        let text = String::from_utf8(written(&g, Format::Usda)).unwrap();
        assert!(text.contains("point3f[] positions = [(0.5, -1.0, -2e-9)]\n"), "{text}");
        assert!(text.contains("float3[] extent = [(-2.5, -4.0, -3.0), (3.5, 2.0, 3.0)]\n"), "{text}");
    }
}
