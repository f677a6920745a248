//! Gaussians of a small bundle: a SOG file, and the planes, which SOG has no place for.
//!
//! Five bytes a plane, in the order of the SOG file: the normal's octahedral coordinates in 12 bits each (Cigolle et al.,
//! "A Survey of Efficient Representations for Independent Unit Vectors", JCGT 3(2), 2014), and the offset as a multiple of the
//! Gaussian's largest standard deviation, in half precision.

use super::super::Gaussians;
use super::{order, quantise, sog, sog_read};
use crate::stored_zip;
use glam::{DVec2, DVec3};
use half::f16;

/// Bytes of a plane.
const PLANE: usize = 5;
/// Largest octahedral coordinate.
const MOST: u32 = 0xfff;

/// The bytes of the SOG file and of the planes.
///
/// # Errors
/// Why the format cannot hold the model.
pub fn encode(g: &Gaussians) -> Result<[Vec<u8>; 2], String> {
    let order = order::morton(g);
    let plane = |&index: &usize| plane(g.normals[index], g.offsets[index], g.log_scales[index]);
    let planes = order.iter().flat_map(plane).collect();
    Ok([sog::encode(g, order)?, planes])
}

/// The Gaussians of both; without planes where their bytes are left out.
///
/// # Errors
/// What is wrong.
pub fn decode(sog: &[u8], planes: Option<&[u8]>) -> Result<Gaussians, String> {
    let mut g = sog_read::read(sog)?;
    let Some(planes) = planes else { return without_planes(g) };
    if planes.len() != PLANE * g.len() {
        return Err(format!("it has {} Gaussians and {} bytes of planes, {PLANE} each", g.len(), planes.len()));
    }
    for (&[a, b, c, low, high], scales) in planes.as_chunks::<PLANE>().0.iter().zip(&g.log_scales) {
        let [a, b, c] = [a, b, c].map(u32::from);
        let normal = from_octahedral([a | (b & 0xf) << 8, b >> 4 | c << 4]);
        g.normals.push(normal.as_vec3().to_array());
        g.offsets.push((f64::from(f16::from_le_bytes([low, high])) * largest(scales)) as f32);
    }
    g.validate().map_err(|error| error.to_string())?;
    Ok(g)
}

/// The part of a SOG file that [`decode_base`] needs, from the beginning of its bytes; none where its harmonics do not begin
/// within them.
pub fn base_of(start: &[u8]) -> Option<Vec<u8>> {
    stored_zip::before(start, sog::HARMONICS)
}

/// The Gaussians with their constant colours alone, and without planes.
///
/// # Errors
/// What is wrong.
pub fn decode_base(sog: &[u8]) -> Result<Gaussians, String> {
    without_planes(sog_read::read_base(sog)?)
}

fn without_planes(mut g: Gaussians) -> Result<Gaussians, String> {
    g.remove_planes();
    g.validate().map_err(|error| error.to_string())?;
    Ok(g)
}

fn plane(normal: [f32; 3], offset: f32, scales: [f32; 3]) -> [u8; PLANE] {
    let [u, v] = octahedral(DVec3::from(normal.map(f64::from)));
    let [a, b, c, _] = (u | v << 12).to_le_bytes();
    let relative = f64::from(offset) / largest(&scales);
    let [low, high] = f16::from_f64(relative.clamp(f16::MIN.into(), f16::MAX.into())).to_le_bytes();
    [a, b, c, low, high]
}

/// Largest standard deviation.
fn largest(log_scales: &[f32; 3]) -> f64 {
    f64::from(log_scales.iter().copied().fold(f32::NEG_INFINITY, f32::max)).exp()
}

/// A direction as a point of the unfolded octahedron; (0, 0, 0) counts as +z.
fn octahedral(direction: DVec3) -> [u32; 2] {
    let length = direction.abs().element_sum();
    let d = if length > 0.0 { direction / length } else { DVec3::Z };
    let folded = if d.z >= 0.0 { d.truncate() } else { fold(d.truncate()) };
    folded.to_array().map(|v| quantise::unit(0.5 * v + 0.5, MOST))
}

fn from_octahedral(point: [u32; 2]) -> DVec3 {
    let p = DVec2::from(point.map(|v| 2.0 * f64::from(v) / f64::from(MOST) - 1.0));
    let z = 1.0 - p.abs().element_sum();
    let p = if z >= 0.0 { p } else { fold(p) };
    p.extend(z).normalize()
}

/// Turns the lower half of the octahedron out, and back.
fn fold(p: DVec2) -> DVec2 {
    (DVec2::ONE - DVec2::new(p.y, p.x).abs()) * DVec2::ONE.copysign(p)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_and_offsets_come_back_within_their_steps() {
        let axes = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z];
        let spiral = (0..500).map(|i| {
            let z = f64::from(i) / 250.0 - 0.998;
            let (sin, cos) = (2.4 * f64::from(i)).sin_cos();
            DVec3::new(cos * (1.0 - z * z).sqrt(), sin * (1.0 - z * z).sqrt(), z)
        });
        for direction in axes.into_iter().chain(spiral) {
            let back = from_octahedral(octahedral(3.0 * direction));
            assert!(back.angle_between(direction) < 1e-3, "{direction} became {back}");
        }
        assert!(from_octahedral(octahedral(DVec3::ZERO)).abs_diff_eq(DVec3::Z, 1e-3));
        let mut g = Gaussians::with_capacity(2, 0);
        for (i, offset) in [(0, 2e-7_f32), (1, -4e4)] {
            g.means.push([i as f32, 0.5, -0.25]);
            g.rotations.push([1.0, 0.0, 0.0, 0.0]);
            g.log_scales.push([-16.0 + 20.0 * i as f32, -17.0, -18.0]);
            g.opacity_logits.push(0.3);
            g.sh.extend([0.1, 0.2, 0.3]);
            g.normals.push([0.0, 0.6, -0.8]);
            g.offsets.push(offset);
        }
        let [sog, mut planes] = encode(&g).unwrap();
        let back = decode(&sog, Some(&planes)).unwrap();
        for (found, expected) in back.offsets.iter().zip(&g.offsets) {
            assert!((found / expected - 1.0).abs() < 2e-3, "{expected} became {found}");
        }
        planes.pop();
        assert!(decode(&sog, Some(&planes)).unwrap_err().contains("9 bytes of planes"));
    }
}
