//! The mask of what moves in a photo, by the evidence of its cells.

/// Largest part of a photo that a mask covers: beyond it the photo is bad as a whole, and nothing is masked.
const LIMIT: f32 = 0.4;
/// Evidence, in units of the scale of all photos, from which a cell is masked, and from which it stays so.
const BEGIN: f32 = 4.0;
const STAY: f32 = 2.5;
/// Cells among a cell and its eight neighbours that fill a hole, and that keep a cell from being an island.
const FILL: usize = 6;
const KEEP: usize = 4;

/// Cells of a photo, row by row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    pub width: usize,
    pub height: usize,
}

impl Grid {
    /// The cell and those around it.
    fn around(self, cell: usize) -> impl Iterator<Item = usize> {
        let (x, y) = (cell % self.width, cell / self.width);
        let rows = y.saturating_sub(1)..(y + 2).min(self.height);
        rows.flat_map(move |v| (x.saturating_sub(1)..(x + 2).min(self.width)).map(move |u| v * self.width + u))
    }

    /// Cells with at least so many set ones around them, themselves counted.
    fn at_least(self, mask: &[bool], least: usize) -> Vec<bool> {
        (0..mask.len()).map(|cell| self.around(cell).filter(|other| mask[*other]).count() >= least).collect()
    }

    /// The next mask of a photo. `differences` are lengths of the cells' mean differences of photo and render, not finite
    /// where there is none; `scale` is what is usual over all photos; `supported` says where warped photos agree with this
    /// one.
    ///
    /// # Panics
    /// With another number of values than cells: a bug of ours.
    pub fn mask(self, differences: &[f32], scale: f32, supported: &[bool], before: &[bool]) -> Vec<bool> {
        let cells = self.width * self.height;
        let lengths = [differences.len(), supported.len(), before.len()];
        assert_eq!(lengths, [cells; 3], "one value a cell");
        let found: Vec<bool> = (0..cells)
            .map(|cell| {
                let known = || self.around(cell).map(|n| differences[n]).filter(|v| v.is_finite());
                let mean = known().sum::<f32>() / known().count() as f32;
                let least = if before[cell] { STAY } else { BEGIN };
                scale > 0.0 && !supported[cell] && mean > least * scale
            })
            .collect();
        let filled = self.at_least(&found, FILL);
        let closed: Vec<bool> = found.iter().zip(filled).map(|(found, filled)| *found || filled).collect();
        let kept = self.at_least(&closed, KEEP);
        let mask: Vec<bool> = closed.iter().zip(kept).map(|(closed, kept)| *closed && kept).collect();
        let masked = mask.iter().filter(|set| **set).count();
        if masked as f32 > LIMIT * cells as f32 { vec![false; cells] } else { mask }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRID: Grid = Grid { width: 10, height: 8 };

    fn block(inside: f32, w: usize, h: usize) -> Vec<f32> {
        let is_inside = |i: usize| (2..2 + w).contains(&(i % 10)) && (2..2 + h).contains(&(i / 10));
        (0..80).map(|i| if is_inside(i) { inside } else { 0.5 }).collect()
    }

    fn count(differences: &[f32], supported: bool, before: bool) -> usize {
        GRID.mask(differences, 1.0, &[supported; 80], &[before; 80]).iter().filter(|set| **set).count()
    }

    #[test]
    fn a_figure_is_masked_unless_other_photos_show_it() {
        assert!(count(&block(20.0, 3, 4), false, false) >= 12);
        assert_eq!(count(&block(20.0, 3, 4), true, false), 0);
        assert_eq!(count(&block(1.5, 3, 4), false, false), 0);
    }

    #[test]
    fn a_masked_cell_stays_longer() {
        assert_eq!(count(&block(3.5, 4, 4), false, false), 0);
        assert!(count(&block(3.5, 4, 4), false, true) > 0);
    }

    #[test]
    fn a_photo_that_is_bad_as_a_whole_has_no_mask() {
        assert_eq!(count(&[20.0; 80], false, false), 0);
    }

    #[test]
    fn what_is_not_finite_is_no_evidence() {
        assert_eq!(count(&[f32::NAN; 80], false, false), 0);
    }
}
