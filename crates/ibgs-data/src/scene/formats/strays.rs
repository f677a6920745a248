//! Gaussians that lie so far out that a format with one range for all positions rounds the others more coarsely.

use super::super::Gaussians;
use super::Loss;

/// The step to which positions are rounded, from the largest coordinate of all and from that of the Gaussian.
pub(super) type Step = fn(reach: f64, at: f64) -> f64;

/// The part of the Gaussians that are not asked whether they are strays, of a thousand.
const USUAL: usize = 999;
/// Strays coarsen the step by this factor at least,
const COARSER: f64 = 2.0;
/// and to more than this part of the usual reach.
const VISIBLE: f64 = 1e-4;

/// What strays cost in a format.
pub(super) fn find(g: &Gaussians, step: Step) -> Option<Loss> {
    let offset = g.file_offset().unwrap_or_default();
    let mut reaches: Vec<f64> = g.positions().map(|position| (position - offset).abs().max_element()).collect();
    let reach = reaches.iter().copied().fold(0.0, f64::max);
    let rank = reaches.len().checked_sub(1)? * USUAL / 1000;
    let usual = *reaches.select_nth_unstable_by(rank, f64::total_cmp).1;
    let [coarse, fine] = [step(reach, usual), step(usual, usual)];
    let count = reaches.iter().filter(|&&own| own > COARSER * usual).count();
    let spoils = count > 0 && coarse >= COARSER * fine && coarse > VISIBLE * usual;
    spoils.then_some(Loss::Strays { count, reach, usual, coarse, fine })
}

#[cfg(test)]
mod tests {
    use crate::scene::formats::tests::{random, round_trip};
    use crate::scene::{Format, Gaussians, Loss};

    fn with_stray(far: f32) -> Gaussians {
        let mut g = random(2000, 0, 95);
        g.means[7][1] = far;
        g
    }

    fn strays(g: &Gaussians, format: Format) -> Option<Loss> {
        format.losses(g).into_iter().find(|loss| matches!(loss, Loss::Strays { .. }))
    }

    #[test]
    fn strays_are_said_where_they_cost_precision() {
        for format in Format::written() {
            let spreads = [Format::Spz, Format::Sog].contains(&format);
            assert_eq!(strays(&with_stray(1e5), format).is_some(), spreads, "{format:?}");
            assert_eq!(strays(&with_stray(60.0), format), None, "{format:?}");
        }
        let Some(Loss::Strays { count, reach, usual, coarse, fine }) = strays(&with_stray(-1e5), Format::Spz) else {
            panic!("no strays");
        };
        assert!((count, reach) == (1, 1e5) && usual > 39.0 && usual < 40.0, "{usual}");
        // 23 bits hold 100,000 with 6 bits behind the point and 40 with 17.
        assert_eq!([coarse, fine], [6, 17].map(|bits| 0.5_f64.powi(bits)));
        let text = strays(&with_stray(-1e5), Format::Spz).unwrap().to_string();
        assert!(
            text.starts_with("1 Gaussian lies up to 100000 from the origin") && text.contains("0.015625"),
            "{text}"
        );
        let error = |g: &Gaussians| {
            let back = round_trip(g, Format::Spz);
            f64::from(back.means.iter().zip(&g.means).map(|(a, b)| (a[2] - b[2]).abs()).fold(0.0, f32::max))
        };
        assert!(error(&with_stray(1e5)) > 0.4 * coarse && error(&with_stray(1.0)) < fine);
    }

    #[test]
    fn one_gaussian_is_no_stray() {
        let mut g = random(1, 0, 96);
        g.means[0] = [1e6; 3];
        assert_eq!(strays(&g, Format::Spz), None);
        assert_eq!(Format::Spz.losses(&Gaussians::default()), []);
    }
}
