//! Twin of the kernel that gathers what a photo differs by, in cells.

/// Three rows of a cell, each with its weight at the end: photo - image, photo - mean of its sources, and (error, detail of the photo,
/// detail of the image).
pub type Evidence = [[f64; 4]; 3];

/// A photo and what it is compared with.
pub struct Compared<'a> {
    pub photo: &'a [[u8; 4]],
    pub width: usize,
    pub image: &'a [[f64; 3]],
    /// Colours of each pixel's sources that agree.
    pub sources: &'a [Vec<[f64; 3]>],
}

fn size_of(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|c| (a[c] - b[c]).abs()).sum::<f64>() / 3.0
}

fn color(texel: [u8; 4]) -> [f64; 3] {
    [0, 1, 2].map(|c| f64::from(texel[c]) / 255.0)
}

/// What one visit says of a cell with these pixels; a row is none where it says nothing.
fn visit(it: &Compared<'_>, xs: std::ops::Range<usize>, ys: std::ops::Range<usize>) -> [Option<[f64; 4]>; 3] {
    let mut sums = Evidence::default();
    for (x, y) in ys.clone().flat_map(|y| xs.clone().map(move |x| (x, y))) {
        let p = y * it.width + x;
        if it.photo[p][3] < 127 {
            continue;
        }
        let own = color(it.photo[p]);
        let mut add = |row: usize, values: [f64; 3]| {
            (0..3).for_each(|c| sums[row][c] += values[c]);
            sums[row][3] += 1.0;
        };
        add(0, [0, 1, 2].map(|c| own[c] - it.image[p][c]));
        let right = (x + 1 < xs.end).then_some(p + 1);
        let below = (y + 1 < ys.end).then_some(p + it.width);
        let others = || right.into_iter().chain(below);
        let of_photo = others().map(|q| size_of(own, color(it.photo[q]))).sum();
        let of_image = others().map(|q| size_of(it.image[p], it.image[q])).sum();
        add(2, [size_of(own, it.image[p]), of_photo, of_image]);
        let sources = &it.sources[p];
        if !sources.is_empty() {
            let mean = |c: usize| sources.iter().map(|s| s[c]).sum::<f64>() / sources.len() as f64;
            add(1, [0, 1, 2].map(|c| own[c] - mean(c)));
        }
    }
    let pixels = sums[0][3];
    [(0, 1.0), (1, pixels / 4.0), (2, 1.0)]
        .map(|(row, least)| (sums[row][3] > 0.0 && sums[row][3] >= least).then(|| sums[row].map(|v| v / sums[row][3])))
}

/// The evidence of a photo's cells of this side after one more visit.
pub fn visited(before: &[Evidence], it: &Compared<'_>, side: usize, rate: f64) -> Vec<Evidence> {
    let (columns, height) = (it.width.div_ceil(side), it.photo.len() / it.width);
    let range = |first: usize, end: usize| first..(first + side).min(end);
    let cell = |(index, before): (usize, &Evidence)| {
        let (xs, ys) = (range(index % columns * side, it.width), range(index / columns * side, height));
        let mut after = *before;
        for (row, found) in after.iter_mut().zip(visit(it, xs, ys)) {
            if let Some(found) = found {
                row.iter_mut().zip(found).for_each(|(old, new)| *old += rate * (new - *old));
            }
        }
        after
    };
    before.iter().enumerate().map(cell).collect()
}
