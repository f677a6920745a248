//! Vector quantisation: a codebook of 256 numbers, and a palette of rows.

use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

/// Entries of a codebook: an index is a byte.
pub(super) const CODES: usize = 256;
/// Values that a codebook is fitted to.
const MOST_SAMPLES: usize = 1 << 20;
const CODEBOOK_ROUNDS: usize = 12;
const PALETTE_ROUNDS: usize = 6;
/// Rows for each entry of the first level that it is fitted to.
const ROWS_PER_ENTRY: usize = 64;

/// 256 numbers, ascending.
pub(super) struct Codebook(pub(super) Vec<f32>);

impl Codebook {
    /// Fits a codebook to finite values. Up to 256 different values are kept as they are. Otherwise it begins with even steps
    /// over the range and with quantiles, half of each, and Lloyd's algorithm lowers the squared error from there: the
    /// root of its mean is at most half an even step.
    pub(super) fn fit(values: impl Iterator<Item = f32>) -> Self {
        let mut values: Vec<f32> = values.collect();
        values.sort_unstable_by(f32::total_cmp);
        let mut distinct = values.clone();
        distinct.dedup();
        if distinct.len() <= CODES {
            let last = distinct.last().copied().unwrap_or_default();
            distinct.resize(CODES, last);
            return Self(distinct);
        }
        let step = values.len().div_ceil(MOST_SAMPLES);
        let (low, high) = (values[0], values[values.len() - 1]);
        let samples: Vec<f32> = values.into_iter().step_by(step).collect();
        let half = CODES / 2;
        let even = |i: usize| low + (high - low) * (i as f32 / (half - 1) as f32);
        let quantile = |i: usize| samples[(2 * i + 1) * samples.len() / (2 * half)];
        let mut codes: Vec<f32> = (0..half).flat_map(|i| [even(i), quantile(i)]).collect();
        codes.sort_unstable_by(f32::total_cmp);
        let sums: Vec<f64> = std::iter::once(0.0)
            .chain(samples.iter().scan(0.0, |sum, &v| {
                *sum += f64::from(v);
                Some(*sum)
            }))
            .collect();
        for _ in 0..CODEBOOK_ROUNDS {
            let ends: Vec<usize> = (0..CODES)
                .map(|i| {
                    codes.get(i + 1).map_or(samples.len(), |&next| {
                        let middle = 0.5 * (codes[i] + next);
                        samples.partition_point(|&v| v < middle)
                    })
                })
                .collect();
            let mut start = 0;
            for (code, end) in codes.iter_mut().zip(ends) {
                if end > start {
                    *code = ((sums[end] - sums[start]) / (end - start) as f64) as f32;
                }
                start = end.max(start);
            }
            codes.sort_unstable_by(f32::total_cmp);
        }
        Self(codes)
    }

    /// The index of the nearest number.
    pub(super) fn nearest(&self, value: f32) -> u8 {
        let above = self.0.partition_point(|&code| code < value).min(CODES - 1);
        let below = above.saturating_sub(1);
        if value - self.0[below] <= self.0[above] - value { below as u8 } else { above as u8 }
    }
}

/// The rows of a palette, and the index of the palette row that stands for each original row.
pub(super) struct Palette {
    /// Entries, `width` values each.
    pub(super) entries: Vec<f32>,
    /// Entry of each row.
    pub(super) labels: Vec<u32>,
}

impl Palette {
    /// At most `most` entries for rows of `width` values. With as many entries as rows each is its own. Otherwise k-means in
    /// two levels: the rows fall into about `sqrt(most)` groups, and each group is split by its share. The same rows give the
    /// same palette.
    pub(super) fn fit(rows: &[f32], width: usize, most: usize) -> Self {
        let count = rows.len() / width;
        if count <= most {
            return Self { entries: rows.to_vec(), labels: (0..count as u32).collect() };
        }
        let row = |index: u32| &rows[width * index as usize..width * (index as usize + 1)];
        let mut order: Vec<u32> = (0..count as u32).collect();
        order.shuffle(&mut ChaCha8Rng::seed_from_u64(0));
        let first_level = most.isqrt().max(1);
        let some = &order[..count.min(ROWS_PER_ENTRY * first_level)];
        let groups = means(some, first_level, width, &row);
        let mut members: Vec<Vec<u32>> = vec![Vec::new(); first_level];
        let found: Vec<usize> = order.par_iter().map(|&index| nearest(&groups, width, row(index))).collect();
        order.iter().zip(found).for_each(|(&index, group)| members[group].push(index));
        members.retain(|group| !group.is_empty());
        let share = |group: &Vec<u32>| (most - members.len()) * group.len() / count + 1;
        let split: Vec<(Vec<f32>, Vec<usize>)> = members
            .par_iter()
            .map(|group| {
                let entries = means(group, share(group).min(group.len()), width, &row);
                let labels = group.iter().map(|&index| nearest(&entries, width, row(index))).collect();
                (entries, labels)
            })
            .collect();
        let mut palette = Self { entries: Vec::new(), labels: vec![0; count] };
        for (group, (entries, labels)) in members.iter().zip(split) {
            let first = palette.entries.len() / width;
            group
                .iter()
                .zip(labels)
                .for_each(|(&index, label)| palette.labels[index as usize] = (first + label) as u32);
            palette.entries.extend(entries);
        }
        palette
    }
}

/// Lloyd's algorithm from the first `count` rows; an entry that no row is near to stays where it is.
fn means<'a>(rows: &[u32], count: usize, width: usize, row: &(impl Fn(u32) -> &'a [f32] + Sync)) -> Vec<f32> {
    let mut entries: Vec<f32> = rows[..count].iter().flat_map(|&index| row(index)).copied().collect();
    if count == rows.len() {
        return entries;
    }
    for _ in 0..PALETTE_ROUNDS {
        let labels: Vec<usize> = rows.par_iter().map(|&index| nearest(&entries, width, row(index))).collect();
        let mut sums = vec![0.0_f64; entries.len()];
        let mut counts = vec![0_u32; count];
        for (&index, label) in rows.iter().zip(labels) {
            counts[label] += 1;
            sums[width * label..][..width].iter_mut().zip(row(index)).for_each(|(sum, &v)| *sum += f64::from(v));
        }
        let filled = entries.chunks_exact_mut(width).zip(sums.chunks_exact(width)).zip(counts).filter(|(_, n)| *n > 0);
        for ((entry, sum), n) in filled {
            entry.iter_mut().zip(sum).for_each(|(value, sum)| *value = (sum / f64::from(n)) as f32);
        }
    }
    entries
}

/// The entry with the least squared distance.
fn nearest(entries: &[f32], width: usize, row: &[f32]) -> usize {
    let distance = |entry: &[f32]| entry.iter().zip(row).map(|(a, b)| (a - b) * (a - b)).sum::<f32>();
    let mut best = (f32::INFINITY, 0);
    for (index, entry) in entries.chunks_exact(width).enumerate() {
        let d = distance(entry);
        if d < best.0 {
            best = (d, index);
        }
    }
    best.1
}
