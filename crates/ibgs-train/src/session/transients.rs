//! What a training says of what moves, at its end.

use super::Session;
use crate::Oddity;
use std::fmt;

/// Photos that are named at most.
const NAMED: usize = 8;

/// What was found of what moves, and of photos that disagree as a whole.
#[derive(Clone, Debug, PartialEq)]
pub struct TransientSummary {
    /// Training photos.
    pub photos: usize,
    /// Those of which something is hidden.
    pub masked: usize,
    /// The hidden part of all photos' cells.
    pub share: f64,
    /// Photos that disagree as a whole, by name; they count less.
    pub odd: Vec<(String, Oddity)>,
}

impl Session {
    /// None where no masks are learned.
    pub(super) fn transient_summary(&self) -> Option<TransientSummary> {
        let (masks, oddities) = (self.trainer.masks()?, self.trainer.oddities()?);
        let hidden = || masks.iter().flat_map(|mask| mask.hidden());
        let names = self.dataset.train.iter().map(|&view| &self.dataset.views[view].name);
        Some(TransientSummary {
            photos: masks.len(),
            masked: masks.iter().filter(|mask| !mask.is_empty()).count(),
            share: hidden().filter(|hidden| **hidden).count() as f64 / hidden().count().max(1) as f64,
            odd: names.zip(oddities).filter_map(|(name, oddity)| Some((name.clone(), oddity?))).collect(),
        })
    }
}

impl fmt::Display for TransientSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { photos, masked, share, odd } = self;
        match masked {
            0 => write!(f, "what moves: nothing is hidden")?,
            _ => write!(f, "what moves: hidden in {masked} of {photos} photos, {:.1} % of all", 100.0 * share)?,
        }
        for (index, (name, oddity)) in odd.iter().take(NAMED).enumerate() {
            let begin = if index == 0 { "\nphotos that disagree as a whole, and count less: " } else { ", " };
            write!(f, "{begin}{name} ({oddity})")?;
        }
        if odd.len() > NAMED { write!(f, " and {} more", odd.len() - NAMED) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_moves_is_said_in_a_sentence() {
        let odd = |count: usize| (0..count).map(|i| (format!("{i}.png"), Oddity::Blurred)).collect();
        let summary = TransientSummary { photos: 40, masked: 6, share: 0.0123, odd: odd(2) };
        assert_eq!(
            summary.to_string(),
            "what moves: hidden in 6 of 40 photos, 1.2 % of all\nphotos that disagree as a whole, and count less: 0.png (blurred), \
             1.png (blurred)"
        );
        let summary = TransientSummary { masked: 0, odd: odd(10), ..summary };
        assert!(summary.to_string().starts_with("what moves: nothing is hidden\n"), "{summary}");
        assert!(summary.to_string().ends_with("7.png (blurred) and 2 more"), "{summary}");
    }
}
