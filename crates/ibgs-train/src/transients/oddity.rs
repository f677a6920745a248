//! Photos that disagree with the others as a whole: blurred ones, those of another brightness, those of something else.

use super::MaskRules;
use super::mask::{Cell, quantile};
use std::fmt;

/// How a photo disagrees as a whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Oddity {
    /// It has less detail than what is rendered from the other photos.
    Blurred,
    /// It is brighter or darker.
    Brightness,
    /// It differs everywhere.
    Everywhere,
}

impl Oddity {
    /// All of them.
    pub(super) const ALL: [Self; 3] = [Self::Blurred, Self::Brightness, Self::Everywhere];
}

impl fmt::Display for Oddity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Blurred => "blurred",
            Self::Brightness => "another brightness",
            Self::Everywhere => "differs everywhere",
        })
    }
}

/// Figures of a photo as a whole.
#[derive(Clone, Copy, Debug, Default)]
struct Figures {
    /// Length of its median difference from the render.
    offset: f32,
    /// Median of the cells' mean absolute differences.
    error: f32,
    /// Its detail, as a part of the render's.
    detail: f32,
}

/// None where nothing of the photo is known.
fn figures(cells: &[Cell]) -> Option<Figures> {
    let median = |c: usize| quantile(cells.iter().filter_map(|cell| Some(cell.difference?[c])).collect(), 0.5);
    let offset = [median(0)?, median(1)?, median(2)?].iter().map(|v| v * v).sum::<f32>().sqrt();
    let known = || cells.iter().filter_map(|cell| cell.error);
    let error = quantile(known().map(|v| v[0]).collect(), 0.5)?;
    let detail = |c: usize| known().map(|v| v[c]).sum::<f32>();
    (detail(2) > 0.0).then(|| Figures { offset, error, detail: detail(1) / detail(2) })
}

/// How each photo disagrees as a whole, by its cells; none where it does not.
pub(super) fn oddities(photos: &[Vec<Cell>], rules: &MaskRules) -> Vec<Option<Oddity>> {
    let all: Vec<Option<Figures>> = photos.iter().map(|cells| figures(cells)).collect();
    let usual = |of: fn(&Figures) -> f32| quantile(all.iter().flatten().map(of).collect(), 0.5).unwrap_or_default();
    let (offset, error, detail) = (usual(|f| f.offset), usual(|f| f.error), usual(|f| f.detail));
    let oddity = |found: &Figures| {
        if found.offset > rules.brightness.max(rules.times * offset) {
            Some(Oddity::Brightness)
        } else if found.error > rules.times * error {
            Some(Oddity::Everywhere)
        } else if found.detail < rules.blurred * detail {
            Some(Oddity::Blurred)
        } else {
            None
        }
    };
    all.iter().map(|found| oddity(found.as_ref()?)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Eight photos that are alike, and one of these values.
    fn with(difference: f32, error: f32, detail: f32) -> Option<Oddity> {
        let photo = |difference: f32, error: f32, detail: f32| {
            let cell = Cell { difference: Some([difference; 3]), error: Some([error, detail, 0.1]), ..Cell::default() };
            vec![cell; 12]
        };
        let mut photos = vec![photo(0.01, 0.02, 0.11); 8];
        photos.push(photo(difference, error, detail));
        let found = oddities(&photos, &MaskRules::default());
        assert!(found[..8].iter().all(Option::is_none));
        found[8]
    }

    #[test]
    fn a_photo_that_disagrees_as_a_whole_is_found() {
        assert_eq!(with(0.015, 0.03, 0.1), None);
        assert_eq!(with(-0.2, 0.2, 0.1), Some(Oddity::Brightness));
        assert_eq!(with(0.01, 0.09, 0.1), Some(Oddity::Everywhere));
        assert_eq!(with(0.01, 0.03, 0.05), Some(Oddity::Blurred));
        assert_eq!(oddities(&[vec![Cell::default(); 3], Vec::new()], &MaskRules::default()), [None, None]);
    }
}
