//! The mask of what moves in a photo, by the evidence of its cells.

use super::MaskRules;

/// A cell's evidence; what is not known is none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cell {
    /// Mean difference of the photo from the render, by channel.
    pub difference: Option<[f32; 3]>,
    /// The same from the photos that are warped to it.
    pub from_sources: Option<[f32; 3]>,
    /// Mean absolute difference from the render, detail of the photo, detail of the render.
    pub error: Option<[f32; 3]>,
}

/// The value at this part of the list, 0 to 1; none of an empty list.
pub fn quantile(mut values: Vec<f32>, part: f64) -> Option<f32> {
    values.sort_unstable_by(f32::total_cmp);
    let last = values.len().checked_sub(1)?;
    Some(values[(part * last as f64).round() as usize])
}

fn length(v: [f32; 3]) -> f32 {
    v.iter().map(|v| v * v).sum::<f32>().sqrt()
}

/// What each cell has beyond what is usual in its photo, by channel: a photo's own brightness is no evidence.
fn levelled(cells: &[Cell], value: fn(&Cell) -> Option<[f32; 3]>) -> Vec<Option<[f32; 3]>> {
    let usual = [0, 1, 2].map(|c| quantile(cells.iter().filter_map(value).map(|v| v[c]).collect(), 0.5).unwrap_or(0.0));
    cells.iter().map(|cell| value(cell).map(|v| [0, 1, 2].map(|c| v[c] - usual[c]))).collect()
}

/// How far the cells of a photo are from the render.
pub fn distances(cells: &[Cell]) -> impl Iterator<Item = f32> {
    levelled(cells, |cell| cell.difference).into_iter().flatten().map(length)
}

/// The next mask of a photo of so many cells in a row. `scale` is what is usual over all photos.
pub fn hidden(cells: &[Cell], columns: usize, before: &[bool], scale: f32, rules: &MaskRules) -> Vec<bool> {
    let scale = scale.max(rules.least / rules.likely);
    let by_render = levelled(cells, |cell| cell.difference);
    let by_sources = levelled(cells, |cell| cell.from_sources);
    let evidence = |(render, sources): (&Option<[f32; 3]>, &Option<[f32; 3]>)| {
        let Some(render) = *render else { return 0.0 };
        let Some(sources) = *sources else { return length(render) / (rules.alone * scale) };
        // What the other photos show as well does not move, however badly it is rendered.
        let far = length(render).min(length(sources));
        let between = length([0, 1, 2].map(|c| render[c] - sources[c]));
        far / scale.max(rules.between * between)
    };
    let evidence: Vec<f32> = by_render.iter().zip(&by_sources).map(evidence).collect();
    let sure: Vec<bool> = evidence
        .iter()
        .zip(before)
        .map(|(v, before)| *v > if *before { rules.sure_again } else { rules.sure })
        .collect();
    let mut mask = vec![false; cells.len()];
    for part in parts(&evidence, columns, rules.likely) {
        if part.iter().filter(|&&cell| sure[cell]).count() >= rules.fewest {
            part.into_iter().for_each(|cell| mask[cell] = true);
        }
    }
    mask
}

/// The connected parts of the cells that are likely.
fn parts(evidence: &[f32], columns: usize, likely: f32) -> Vec<Vec<usize>> {
    let mut open: Vec<bool> = evidence.iter().map(|v| *v > likely).collect();
    let mut parts = Vec::new();
    for first in 0..open.len() {
        if !std::mem::take(&mut open[first]) {
            continue;
        }
        let (mut part, mut next) = (vec![first], 0);
        while let Some(&cell) = part.get(next) {
            next += 1;
            let left = (cell % columns > 0).then(|| cell - 1);
            let right = ((cell + 1) % columns > 0).then_some(cell + 1);
            let beside = [left, right, cell.checked_sub(columns), Some(cell + columns)].into_iter().flatten();
            part.extend(beside.filter(|&other| other < open.len() && std::mem::take(&mut open[other])));
        }
        parts.push(part);
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    const COLUMNS: usize = 10;

    /// 8 rows of cells with a block of other ones in it.
    fn block(inside: f32, [w, h]: [usize; 2]) -> Vec<Cell> {
        let is_inside = |i: usize| (2..2 + w).contains(&(i % COLUMNS)) && (2..2 + h).contains(&(i / COLUMNS));
        let value = |i: usize| if is_inside(i) { inside } else { 0.3 };
        let cell =
            |value| Cell { difference: Some([value, 0.3, 0.3]), from_sources: Some([value, 0.3, 0.3]), error: None };
        (0..80).map(|i| cell(value(i))).collect()
    }

    fn count(cells: &[Cell], before: bool) -> usize {
        hidden(cells, COLUMNS, &[before; 80], 0.05, &MaskRules::default()).iter().filter(|set| **set).count()
    }

    #[test]
    fn a_figure_is_hidden_unless_other_photos_show_it() {
        let mut cells = block(0.9, [3, 4]);
        assert_eq!(count(&cells, false), 12);
        // A corner beside it that is likely, and one that is far away.
        for cell in [5 + 2 * COLUMNS, 9 + 7 * COLUMNS] {
            cells[cell] = block(0.43, [1, 1])[2 + 2 * COLUMNS];
        }
        assert_eq!(count(&cells, false), 13);
        cells.iter_mut().for_each(|cell| cell.from_sources = Some([0.1; 3]));
        assert_eq!(count(&cells, false), 0);
        assert_eq!(count(&block(0.35, [3, 4]), false), 0);
    }

    #[test]
    fn little_things_are_no_figures_and_the_edge_does_not_join_rows() {
        assert_eq!(count(&block(0.9, [2, 1]), false), 0);
        let mut cells = block(0.3, [0, 0]);
        for cell in [8 + COLUMNS, 9 + COLUMNS, 2 * COLUMNS, 1 + 2 * COLUMNS] {
            cells[cell] = block(0.9, [1, 1])[2 + 2 * COLUMNS];
        }
        assert_eq!(count(&cells, false), 0);
    }

    #[test]
    fn a_place_that_is_hard_to_render_is_no_figure() {
        let mirror = |difference: f32, from_sources: f32| {
            let mut cells = block(0.9, [3, 4]);
            for cell in cells.iter_mut().filter(|cell| cell.difference != Some([0.3; 3])) {
                cell.difference = Some([0.3 + difference, 0.3, 0.3]);
                cell.from_sources = Some([0.3 + from_sources, 0.3, 0.3]);
            }
            count(&cells, false)
        };
        assert_eq!([mirror(0.6, 0.6), mirror(0.6, 0.75), mirror(0.6, 0.8)], [12, 12, 0]);
    }

    #[test]
    fn without_other_photos_more_is_asked() {
        let alone = |inside| {
            let mut cells = block(inside, [3, 4]);
            cells.iter_mut().for_each(|cell| cell.from_sources = None);
            count(&cells, false)
        };
        assert_eq!([alone(0.3 + 0.05 * 11.5), alone(0.3 + 0.05 * 12.5)], [0, 12]);
    }

    #[test]
    fn a_hidden_cell_stays_longer() {
        let cells = block(0.3 + 0.05 * 3.5, [4, 4]);
        assert_eq!((count(&cells, false), count(&cells, true)), (0, 16));
    }

    #[test]
    fn another_brightness_of_the_whole_photo_is_no_evidence() {
        assert_eq!(count(&vec![Cell { difference: Some([0.9; 3]), ..Cell::default() }; 80], false), 0);
        assert_eq!(count(&[Cell::default(); 80], false), 0);
    }
}
