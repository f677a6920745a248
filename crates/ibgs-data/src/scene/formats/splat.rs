//! `.splat` files: 32 bytes a Gaussian and nothing else, the largest and most opaque first.
//!
//! Position and scale as three floats each, colour of degree 0 and opacity as four bytes, the unit quaternion as w, x, y, z in
//! four bytes (128 is 0, a step 1/128).

use super::super::{Gaussians, SH_C0};
use super::quantise::{self, byte};
use super::{Steps, Writing, axes};
use std::io::{self, Write};

pub(super) const ROW: super::Row = super::Row {
    name: "`.splat`",
    ending: ".splat",
    marks: &[],
    axes: axes::RDF,
    max_sh_degree: 0,
    steps: Steps { rotation: 1.0 / 128.0, sh: [1.0 / 255.0 / SH_C0, 0.0, 0.0, 0.0] },
    position_step: None,
    keeps_antialiased: false,
    place_of_offset: None,
    writing: Writing::By(|g| Ok(Box::new(move |out| write(g, out)))),
    read: Some(|bytes, _| read(bytes)),
};

/// Bytes of a Gaussian.
const EACH: usize = 32;

/// Writes all Gaussians by their size times their opacity: viewers show the first ones first while they load.
fn write(g: &Gaussians, out: &mut dyn Write) -> io::Result<()> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Loss;
    use crate::scene::formats::Format;
    use crate::scene::formats::tests::{OPACITY, errors, random, read_named, round_trip, rounding, written};

    #[test]
    fn errors_are_half_a_step() {
        let g = random(700, 2, 4);
        let back = round_trip(&g, Format::Splat);
        assert_eq!(back.sh_degree, 0);
        // Positions are kept to the bit, and no two are alike.
        let index_of = |mean: &[f32; 3]| g.means.iter().position(|other| other == mean).unwrap();
        let order: Vec<usize> = back.means.iter().map(index_of).collect();
        let e = errors(&g, &back, &order);
        assert_eq!(e.mean, 0.0);
        assert!(e.log_scale <= rounding(8.0) && e.opacity <= OPACITY, "{e:?}");
        // A component near 1 is cut at 127/128, a whole step; the length of 1 is restored by up to sqrt(4) times that.
        assert!(e.rotation <= 2.0 / 128.0, "{e:?}");
        assert!(e.color <= 0.5 / 255.0 + rounding(1.0), "{e:?}");
        let weight = |at: usize| -> f64 {
            let size: f32 = back.log_scales[at].iter().sum();
            f64::from(size).exp() * quantise::opacity(back.opacity_logits[at])
        };
        // Opacities moved by half a step of at least 1/150.
        assert!((1..back.len()).all(|at| weight(at) <= weight(at - 1) * 1.7), "the largest come first");
        assert_eq!(Format::Splat.losses(&g), [Loss::Harmonics { degree: 2, kept: 0 }]);
    }

    #[test]
    fn axes_are_those_of_memory() {
        let mut g = random(1, 0, 50);
        g.means[0] = [0.5, 1.0, 2.0];
        assert_eq!(bytemuck::pod_collect_to_vec::<u8, f32>(&written(&g, Format::Splat)[..12]), [0.5, 1.0, 2.0]);
    }

    #[test]
    fn files_that_make_no_sense() {
        let refused = |bytes: &[u8]| read_named(bytes, "a.splat").unwrap_err().to_string();
        assert!(refused(&[7; 33]).contains("multiple of 32"));
        assert!(refused(&[0xff; 64]).contains("`position` of Gaussian 0"));
    }
}
