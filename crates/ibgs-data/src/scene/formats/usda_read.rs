//! Reading of OpenUSD text, see [`super::usda`].

use super::super::Gaussians;
use super::super::gaussians::coefficients;
use super::gltf_nodes::Pose;
use super::usda::PRIM;
use super::usda_text::{Prim, Value, parse};
use super::{MAX_SH_DEGREE, quantise};
use glam::{DMat4, DQuat, DVec3};

const COEFFICIENTS: &str = "radiance:sphericalHarmonicsCoefficients";
const DEGREE: &str = "radiance:sphericalHarmonicsDegree";
/// The order of the steps that move a prim.
const ORDER: &str = "xformOpOrder";
/// What each step is called.
const STEP: &str = "xformOp:";
/// Arrays of a prim; each may be one of halves, with an `h` behind its name.
const ARRAYS: [&str; 5] = ["positions", "orientations", "scales", "opacities", COEFFICIENTS];

/// Reads a whole file: all Gaussians of its prims, with its axes turned so that y points up.
///
/// # Errors
/// What is wrong.
pub(super) fn read(bytes: &[u8]) -> Result<Gaussians, String> {
    if !bytes.starts_with(b"#usda") {
        return Err("it is no text of OpenUSD; convert it with `usdcat` into one".to_owned());
    }
    let text = std::str::from_utf8(bytes).map_err(|error| format!("it is no text ({error})"))?;
    let layer = parse(text, &is_wanted)?;
    let up = if layer.is_z_up {
        DMat4::from_quat(DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2))
    } else {
        DMat4::IDENTITY
    };
    let mut found = Vec::new();
    gather(&layer.prims, up, &mut found)?;
    match found.is_empty() {
        true => Err(format!("it has no prim `{PRIM}`")),
        false => Ok(Gaussians::joined(found)),
    }
}

fn is_wanted(name: &str) -> bool {
    let is_array = ARRAYS.contains(&name) || name.strip_suffix('h').is_some_and(|name| ARRAYS.contains(&name));
    is_array || [DEGREE, ORDER].contains(&name) || name.starts_with(STEP)
}

/// The Gaussians of prims and of those below them, moved.
fn gather(prims: &[Prim], above: DMat4, found: &mut Vec<Gaussians>) -> Result<(), String> {
    for prim in prims {
        let world = above * local(prim)?;
        if prim.kind == PRIM {
            let mut part = gaussians(prim)?;
            Pose::of(world)?.apply(&mut part);
            found.push(part);
        }
        gather(&prim.children, world, found)?;
    }
    Ok(())
}

/// How a prim is moved against the one above it.
fn local(prim: &Prim) -> Result<DMat4, String> {
    let Some(order) = prim.properties.get(ORDER) else { return Ok(DMat4::IDENTITY) };
    order.strings.iter().try_fold(DMat4::IDENTITY, |matrix, name| {
        let numbers = prim.properties.get(name).map(|value| value.numbers.as_slice());
        let step = numbers.and_then(|numbers| step(name, numbers));
        step.map(|step| matrix * step)
            .ok_or_else(|| format!("its `{}` is no movement that is read", name.escape_debug()))
    })
}

fn step(name: &str, numbers: &[f64]) -> Option<DMat4> {
    let kind = name.strip_prefix(STEP)?.split(':').next()?;
    Some(match (kind, numbers) {
        ("translate", &[x, y, z]) => DMat4::from_translation(DVec3::new(x, y, z)),
        ("scale", &[x, y, z]) => DMat4::from_scale(DVec3::new(x, y, z)),
        ("orient", &[w, x, y, z]) => DMat4::from_quat(DQuat::from_xyzw(x, y, z, w).normalize()),
        ("rotateX", &[angle]) => DMat4::from_rotation_x(angle.to_radians()),
        ("rotateY", &[angle]) => DMat4::from_rotation_y(angle.to_radians()),
        ("rotateZ", &[angle]) => DMat4::from_rotation_z(angle.to_radians()),
        ("rotateXYZ", &[x, y, z]) => {
            let [x, y, z] = [x, y, z].map(f64::to_radians);
            DMat4::from_rotation_z(z) * DMat4::from_rotation_y(y) * DMat4::from_rotation_x(x)
        }
        // Its rows are those of points that stand on the left, so they are our columns.
        ("transform", numbers) => DMat4::from_cols_array(numbers.try_into().ok()?),
        _ => return None,
    })
}

/// The Gaussians of a prim in its own coordinates.
fn gaussians(prim: &Prim) -> Result<Gaussians, String> {
    let array = |name: &str| {
        let value = prim.properties.get(name).or_else(|| prim.properties.get(&format!("{name}h")));
        value.map(|Value { numbers, .. }| numbers.as_slice())
    };
    let positions = array("positions").ok_or_else(|| format!("a prim `{PRIM}` lacks its `positions`"))?;
    let count = positions.len() / 3;
    // What a prim lacks has the value that the schema gives it.
    let rows = |name: &str, usual: &[f64]| -> Result<Vec<f64>, String> {
        let needed = count * usual.len();
        match array(name) {
            None => Ok(usual.repeat(count)),
            Some(values) if values.len() >= needed => Ok(values[..needed].to_vec()),
            Some(values) => Err(format!(
                "its `{name}` has {} numbers where {needed} are needed for {count} Gaussians",
                values.len()
            )),
        }
    };
    let degree = match prim.properties.get(DEGREE).map(|value| value.numbers.as_slice()) {
        None => MAX_SH_DEGREE,
        Some(&[degree]) if (0..=MAX_SH_DEGREE).any(|known| f64::from(known) == degree) => degree as u32,
        Some(other) => return Err(format!("its `{DEGREE}` is {other:?}; degrees 0 to {MAX_SH_DEGREE} are read")),
    };
    // Without coefficients they are grey.
    let degree = if array(COEFFICIENTS).is_none() { 0 } else { degree };
    let mut g = Gaussians::with_capacity(count, degree);
    g.means = triples(&rows("positions", &[0.0; 3])?, |v| v as f32);
    let quaternion = |q: &[f64; 4]| quantise::read_quaternion(q.map(|v| v as f32));
    g.rotations = rows("orientations", &[1.0, 0.0, 0.0, 0.0])?.as_chunks().0.iter().map(quaternion).collect();
    g.log_scales = triples(&rows("scales", &[1.0; 3])?, |v| quantise::log_scale(v as f32));
    let logit = |&opacity: &f64| quantise::logit(opacity, quantise::FLOAT_STEP);
    g.opacity_logits = rows("opacities", &[1.0])?.iter().map(logit).collect();
    g.sh = rows(COEFFICIENTS, &vec![0.0; 3 * coefficients(degree)])?.iter().map(|&v| v as f32).collect();
    Ok(g)
}

fn triples(values: &[f64], change: impl Fn(f64) -> f32) -> Vec<[f32; 3]> {
    values.as_chunks::<3>().0.iter().map(|row| row.map(&change)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::formats::tests::read_named;

    fn read_text(text: &str) -> Result<Gaussians, String> {
        read_named(text.as_bytes(), "a.usda").map_err(|error| error.to_string())
    }

    /// A prim as another program would write it.
    const TEXT: &str = r#"#usda 1.0
(
    "A comment with ) in it"
    upAxis = "Y" # not Z
    customLayerData = { string by = 'someone "else"' }
)
class "Template" { float a = 1 }
def Xform "World" (
    prepend apiSchemas = ["SomeAPI"]
    doc = """three
lines }"""
)
{
    double3 xformOp:translate = (1, 2, 3)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    rel material:binding = </World/Looks>
    float size.timeSamples = { 0: 1, 1: 2 }
    asset picture = @a{b.png@

    over ParticleField3DGaussianSplat "Old" { point3f[] positions = [(0, 0, 0)] }
    def ParticleField3DGaussianSplat "Splats"
    {
        uniform bool doubleSided
        float3[] extent = [(-1, -1, -1), (1, 1, 1)]; point3f[] positions = [(1, 0, 0), (0, 1, -2.5e1)]
        quath[] orientationsh = [(0, 1, 0, 0), (1, 0, 0, 0)] (interpolation = "vertex")
        float3[] scales = [(1, 1, 1), (0.5, 0.5, 0.5),]
        float[] opacities = [0.5, 0.25]
        uniform int radiance:sphericalHarmonicsDegree = 0
        float3[] radiance:sphericalHarmonicsCoefficients = [(0.1, 0.2, 0.3), (0.4, 0.5, 0.6)] (
            elementSize = 1
        )
    }
}
"#;

    #[test]
    fn files_of_other_programs() {
        let g = read_text(TEXT).unwrap();
        // y and z change their signs.
        let positions: Vec<DVec3> = g.positions().collect();
        assert_eq!(positions, [DVec3::new(2.0, -2.0, -3.0), DVec3::new(1.0, -3.0, 22.0)]);
        assert_eq!((&g.rotations[0], g.log_scales[1][0]), (&[0.0, 1.0, 0.0, 0.0], 0.5_f32.ln()));
        assert_eq!((g.opacity_logits[0], &g.sh[..3]), (0.0, &[0.1, 0.2, 0.3][..]));
        let up = read_text(&TEXT.replace("upAxis = \"Y\"", "upAxis = \"Z\"")).unwrap();
        // z points up: y of the file is forward.
        assert!(up.positions().next().unwrap().abs_diff_eq(DVec3::new(2.0, -3.0, 2.0), 1e-6));
        let without = TEXT.replace("float[] opacities", "float[] others").replace("radiance:", "other:");
        let plain = read_text(&without).unwrap();
        assert!(plain.sh_degree == 0 && plain.sh.iter().all(|&v| v == 0.0) && plain.opacity_logits[0] > 10.0);
    }

    #[test]
    fn prims_move() {
        let moved = |steps: &str, order: &str| {
            let text = TEXT.replace("double3 xformOp:translate = (1, 2, 3)", steps);
            let g = read_text(&text.replace("[\"xformOp:translate\"]", order))?;
            Ok::<_, String>((g.positions().next().unwrap(), g.log_scales[0][0]))
        };
        let close = |found: Result<(DVec3, f32), String>, x: f64, y: f64, z: f64| {
            let (place, _) = found.unwrap();
            assert!(place.abs_diff_eq(DVec3::new(x, -y, -z), 1e-6), "{place}");
        };
        close(moved("float3 xformOp:rotateXYZ = (0, 0, 90)", "[\"xformOp:rotateXYZ\"]"), 0.0, 1.0, 0.0);
        close(moved("float xformOp:rotateY:a = 90", "[\"xformOp:rotateY:a\"]"), 0.0, 0.0, -1.0);
        close(moved("quatf xformOp:orient = (0, 0, 0, 2)", "[\"xformOp:orient\"]"), -1.0, 0.0, 0.0);
        let matrix = "matrix4d xformOp:transform = ((2, 0, 0, 0), (0, 2, 0, 0), (0, 0, 2, 0), (5, 6, 7, 1))";
        let found = moved(matrix, "[\"xformOp:transform\"]");
        assert_eq!(found.as_ref().unwrap().1, 2.0_f32.ln());
        close(found, 7.0, 6.0, 7.0);
        let two = "float3 xformOp:scale = (2, 2, 2)\n double3 xformOp:translate = (1, 2, 3)";
        close(moved(two, "[\"xformOp:scale\", \"xformOp:translate\"]"), 4.0, 4.0, 6.0);
        let refused = |steps: &str, order: &str| moved(steps, order).unwrap_err();
        assert!(refused("float3 xformOp:scale = (1, 2, 1)", "[\"xformOp:scale\"]").contains("stretches"));
        assert!(refused("int a = 1", "[\"xformOp:scale\"]").contains("`xformOp:scale` is no movement"));
        assert!(refused("int a = 1", "[\"!invert!xformOp:scale\"]").contains("no movement"));
    }

    #[test]
    fn files_that_make_no_sense() {
        let cases = [
            ("#usda 1.0", "#usdc 1.0", "no text of OpenUSD"),
            ("(0.4, 0.5, 0.6)", "", "has 3 numbers where 6 are needed for 2 Gaussians"),
            ("0.25]", "x]", "has `x` where a number must be (`opacities`)"),
            ("HarmonicsDegree = 0", "HarmonicsDegree = 4", "degrees 0 to 3"),
            ("point3f[] positions = [(1", "point3f[] place = [(1", "lacks its `positions`"),
            ("def ParticleField3DGaussianSplat", "def Mesh", "no prim `ParticleField3DGaussianSplat`"),
            ("0.25]", "{]", "has a value that is no list"),
            ("</World/Looks>", "</World/Looks", "path that does not end"),
            ("lines }\"\"\"", "", "string that does not end"),
            ("def Xform", "Xform", "is no prim"),
            ("def Xform \"World\"", "def Xform", "prim without a name"),
        ];
        for (from, to, expected) in cases {
            assert!(TEXT.contains(from));
            let text = read_text(&TEXT.replace(from, to)).unwrap_err();
            assert!(
                text.contains(expected) && text.contains("a.usda") && !text.contains('\n'),
                "{from} -> {to}: {text}"
            );
        }
        for end in 0..TEXT.len() - 2 {
            assert!(read_text(&TEXT[..end]).is_err(), "{end}");
        }
        let deep = format!("#usda 1.0\n{}", "def \"a\" {".repeat(100_000));
        assert!(read_text(&deep).unwrap_err().contains("more than 64 prims"));
        read_named(&[b"#usda 1.0\n\xff"[..].to_vec()].concat(), "a").unwrap_err();
    }
}
