//! Twins of the kernels of learned masks: a photo in cells of 8 x 8 pixels, and a mask in its alpha.

const CELL: usize = 8;

/// Sums of a cell: of photo - image with the pixels, and of photo - mean of the sources with the pixels that have any.
pub type Sums = [[f64; 4]; 2];

/// The sums of a photo of this width. `sources` are the colours of each pixel's sources that agree.
pub fn cells(photo: &[[u8; 4]], width: usize, image: &[[f64; 3]], sources: &[Vec<[f64; 3]>]) -> Vec<Sums> {
    let columns = width.div_ceil(CELL);
    let mut sums = vec![Sums::default(); columns * (photo.len() / width).div_ceil(CELL)];
    for (p, texel) in photo.iter().enumerate().filter(|(_, texel)| texel[3] >= 127) {
        let sum = &mut sums[p / width / CELL * columns + p % width / CELL];
        let color = [0, 1, 2].map(|c| f64::from(texel[c]) / 255.0);
        let mut add = |row: usize, other: [f64; 3]| {
            (0..3).for_each(|c| sum[row][c] += color[c] - other[c]);
            sum[row][3] += 1.0;
        };
        add(0, image[p]);
        if !sources[p].is_empty() {
            let mean = |c: usize| sources[p].iter().map(|s| s[c]).sum::<f64>() / sources[p].len() as f64;
            add(1, [mean(0), mean(1), mean(2)]);
        }
    }
    sums
}

/// Alpha of a photo under a mask; `had` is its own alpha.
pub fn masked_alpha(had: &[u8], width: usize, mask: &[bool]) -> Vec<u8> {
    let columns = width.div_ceil(CELL);
    let alpha = |(p, had): (usize, &u8)| match (*had >= 128, mask[p / width / CELL * columns + p % width / CELL]) {
        (false, _) => 0,
        (true, true) => 127,
        (true, false) => 255,
    };
    had.iter().enumerate().map(alpha).collect()
}
