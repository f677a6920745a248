//! `.splat` files: 32 bytes a Gaussian and nothing else, the largest and most opaque first.
//!
//! Position and scale as three floats each, colour of degree 0 and opacity as four bytes, the unit quaternion as w, x, y, z in
//! four bytes (128 is 0, a step 1/128). Axes are those of 3DGS.

use super::super::Gaussians;
use super::Format;
use super::quantise::{self, byte};
use std::io::{self, Write};

pub(super) const ROW: super::Row = super::Row {
    format: Format::Splat,
    ending: ".splat",
    marks: &[],
    max_sh_degree: 0,
    place_of_offset: None,
    writer: Some(|g| Ok(Box::new(move |out| write(g, out)))),
    read: Some(|bytes, _| read(bytes)),
};

/// Bytes of a Gaussian.
const EACH: usize = 32;

/// Writes all Gaussians by their size times their opacity: viewers show the first ones first while they load.
pub(super) fn write(g: &Gaussians, out: &mut dyn Write) -> io::Result<()> {
    let weight = |(scales, &logit): (&[f32; 3], &f32)| -> f64 {
        scales.iter().map(|&s| f64::from(s)).sum::<f64>() + quantise::opacity(logit).ln()
    };
    let weights: Vec<f64> = g.log_scales.iter().zip(&g.opacity_logits).map(weight).collect();
    let mut order: Vec<usize> = (0..g.len()).collect();
    order.sort_by(|&a, &b| weights[b].total_cmp(&weights[a]));
    let row = 3 * g.sh_coefficients();
    for index in order {
        let scales = g.log_scales[index].map(f32::exp);
        for v in g.means[index].into_iter().chain(scales) {
            out.write_all(&v.to_le_bytes())?;
        }
        let color = |channel: usize| byte(255.0 * quantise::color(g.sh[row * index + channel]));
        out.write_all(&[color(0), color(1), color(2), quantise::opacity_byte(g.opacity_logits[index])])?;
        out.write_all(&quantise::unit_quaternion(g.rotations[index]).map(|v| byte(128.0 * v + 128.0)))?;
    }
    Ok(())
}

/// Reads a whole file.
///
/// # Errors
/// What is wrong.
fn read(bytes: &[u8]) -> Result<Gaussians, String> {
    if !bytes.len().is_multiple_of(EACH) {
        return Err(format!("its {} bytes are no multiple of {EACH}, the size of a Gaussian", bytes.len()));
    }
    let count = bytes.len() / EACH;
    let mut g = Gaussians::with_capacity(count, 0);
    for row in bytes.chunks_exact(EACH) {
        let float = |at: usize| f32::from_le_bytes([row[4 * at], row[4 * at + 1], row[4 * at + 2], row[4 * at + 3]]);
        g.means.push([0, 1, 2].map(float));
        g.log_scales.push([3, 4, 5].map(|at| quantise::log_scale(float(at))));
        g.sh.extend([24, 25, 26].map(|at| quantise::dc(f64::from(row[at]) / 255.0)));
        g.opacity_logits.push(quantise::logit_of_byte(row[27]));
        let rotation = [28, 29, 30, 31].map(|at| (f32::from(row[at]) - 128.0) / 128.0);
        g.rotations.push(quantise::read_quaternion(rotation));
    }
    Ok(g)
}
