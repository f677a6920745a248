//! The colours of Gaussians in a glTF file: those of the screen, or linear ones that become them.

use super::super::Gaussians;
use super::gltf_nodes::{basis, directions};
use crate::dataset::srgb;
use glam::DVec3;
use serde_json::Value;
use std::path::Path;

/// The property `colorSpace` of the extension.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum ColorSpace {
    /// sRGB, as 3DGS trains it.
    Srgb,
    /// Linear, with the primaries of sRGB.
    Linear,
    /// The file does not say; taken as sRGB.
    Unsaid,
}

impl ColorSpace {
    /// Of the extension of a primitive.
    ///
    /// # Errors
    /// Where it is no colour space that is read.
    pub(super) fn of(extension: &Value) -> Result<Self, String> {
        match extension.get("colorSpace") {
            None => Ok(Self::Unsaid),
            Some(Value::String(name)) if name == "srgb_rec709_display" => Ok(Self::Srgb),
            Some(Value::String(name)) if name == "lin_rec709_display" => Ok(Self::Linear),
            Some(other) => Err(format!(
                "its Gaussians have the `colorSpace` {other}; \"srgb_rec709_display\" and \"lin_rec709_display\" are read"
            )),
        }
    }

    /// Says in the log which colours of the file at `path` are no sRGB, or may be none.
    pub(super) fn say(mut all: impl Iterator<Item = Self> + Clone, path: &Path) {
        if all.clone().any(|space| space == Self::Linear) {
            log::warn!(
                "{}: its colours are linear (`lin_rec709_display`) and are converted to sRGB; where Gaussians overlap, their \
                 mix differs from that of the program that made the file",
                path.display()
            );
        }
        if all.any(|space| space == Self::Unsaid) {
            log::warn!("{}: it lacks `colorSpace`; its colours are taken as sRGB", path.display());
        }
    }

    /// Makes sRGB of the colours. Harmonics of linear colours become those nearest, in the mean over all directions, to what
    /// they show in sRGB.
    pub(super) fn convert(self, g: &mut Gaussians) {
        if self != Self::Linear {
            return;
        }
        let count = g.sh_coefficients();
        let samples: Vec<([f64; 16], f64)> = match count {
            // One direction is enough for a constant.
            1 => vec![(basis(DVec3::Z), basis(DVec3::Z)[0].powi(-2))],
            _ => directions().map(|(direction, weight)| (basis(direction), weight)).collect(),
        };
        for row in g.sh.chunks_exact_mut(3 * count) {
            for channel in 0..3 {
                let own: [f64; 16] = std::array::from_fn(|k| row.get(3 * k + channel).map_or(0.0, |&v| f64::from(v)));
                let mut fitted = [0.0; 16];
                for (basis, weight) in &samples {
                    let linear = 0.5 + basis.iter().zip(own).map(|(basis, v)| basis * v).sum::<f64>();
                    let color = f64::from(srgb(linear.max(0.0) as f32)) - 0.5;
                    fitted.iter_mut().zip(basis).for_each(|(sum, basis)| *sum += weight * color * basis);
                }
                (0..count).for_each(|k| row[3 * k + channel] = fitted[k] as f32);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::SH_C0;
    use serde_json::json;

    /// A linear colour of a fifth is shown as 0.4845 in sRGB, in every degree; what depends on the view keeps its direction.
    #[test]
    fn linear_colors_become_what_the_screen_shows() {
        for degree in 0..=3 {
            let count = (degree as usize + 1).pow(2);
            let mut sh = vec![0.0; 3 * count];
            [0.2, 1.0, 0.0].iter().enumerate().for_each(|(c, v)| sh[c] = ((v - 0.5) / SH_C0) as f32);
            let mut g = Gaussians { sh, sh_degree: degree, ..Gaussians::default() };
            let before = g.clone();
            ColorSpace::Srgb.convert(&mut g);
            assert_eq!(g, before);
            ColorSpace::Linear.convert(&mut g);
            for (found, expected) in g.sh.iter().zip([0.484_529, 1.0, 0.0]) {
                assert!((0.5 + SH_C0 * f64::from(*found) - expected).abs() < 1e-5, "degree {degree}: {found}");
            }
            assert!(g.sh[3..].iter().all(|v| v.abs() < 1e-6), "{:?}", g.sh);
        }
        let dc = ((0.2 - 0.5) / SH_C0) as f32;
        let mut g =
            Gaussians { sh: [[dc; 3], [0.0; 3], [0.05; 3], [0.0; 3]].concat(), sh_degree: 1, ..Default::default() };
        ColorSpace::Linear.convert(&mut g);
        let shown = |direction: DVec3| -> f64 {
            0.5 + (0..4).map(|k| basis(direction)[k] * f64::from(g.sh[3 * k])).sum::<f64>()
        };
        for direction in [DVec3::Z, DVec3::NEG_Z, DVec3::X] {
            let linear = 0.2 + basis(direction)[2] * 0.05;
            assert!((shown(direction) - f64::from(srgb(linear as f32))).abs() < 2e-3, "{direction}");
        }
    }

    #[test]
    fn unknown_color_spaces_are_refused() {
        let of = |value: Value| ColorSpace::of(&json!({"colorSpace": value}));
        assert_eq!(of(json!("srgb_rec709_display")), Ok(ColorSpace::Srgb));
        assert_eq!(of(json!("lin_rec709_display")), Ok(ColorSpace::Linear));
        assert_eq!(ColorSpace::of(&json!({"kernel": "ellipse"})), Ok(ColorSpace::Unsaid));
        for value in [json!("acescg"), json!(3), json!(null)] {
            let text = of(value.clone()).unwrap_err();
            assert!(text.contains("colorSpace") && text.contains(&value.to_string()), "{text}");
        }
    }
}
