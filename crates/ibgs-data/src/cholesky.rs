//! Linear systems with a symmetric positive matrix.

use rayon::prelude::*;

/// Rows below which threads cost more than they save.
const ROWS_EACH: usize = 32;

/// A dense symmetric matrix, of which the lower triangle is read.
#[derive(Clone, Debug)]
pub struct Symmetric {
    size: usize,
    /// Row by row.
    values: Vec<f64>,
}

/// The sum of products, in four lanes: always the same order.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<4>(), b.as_chunks::<4>());
    let mut lanes = [0.0; 4];
    for (a, b) in a.iter().zip(b) {
        for (lane, (a, b)) in lanes.iter_mut().zip(a.iter().zip(b)) {
            *lane += a * b;
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    lanes[0] + lanes[1] + (lanes[2] + lanes[3]) + rest
}

impl Symmetric {
    /// Of zeros.
    pub fn zero(size: usize) -> Self {
        Self { size, values: vec![0.0; size * size] }
    }

    /// Adds to an entry; one above the diagonal is left out.
    pub fn add(&mut self, row: usize, column: usize, value: f64) {
        if column <= row {
            self.values[row * self.size + column] += value;
        }
    }

    /// Adds another one of the same size.
    pub fn add_all(&mut self, other: &Self) {
        self.values.iter_mut().zip(&other.values).for_each(|(sum, v)| *sum += v);
    }

    /// The solution for this right side; none where the matrix is not positive to rounding.
    pub fn solve(mut self, mut right: Vec<f64>) -> Option<Vec<f64>> {
        self.factorize()?;
        let size = self.size;
        let row = |i: usize| &self.values[i * size..(i + 1) * size];
        for i in 0..size {
            right[i] = (right[i] - dot(&row(i)[..i], &right[..i])) / row(i)[i];
        }
        for i in (0..size).rev() {
            right[i] /= row(i)[i];
            let value = right[i];
            right[..i].iter_mut().zip(row(i)).for_each(|(v, l)| *v -= value * l);
        }
        right.iter().all(|v| v.is_finite()).then_some(right)
    }

    /// The lower triangle becomes that of Cholesky, column by column.
    fn factorize(&mut self) -> Option<()> {
        let size = self.size;
        for j in 0..size {
            let (above, below) = self.values.split_at_mut((j + 1) * size);
            let row = &mut above[j * size..];
            let pivot = row[j] - dot(&row[..j], &row[..j]);
            if pivot.is_nan() || pivot <= row[j].abs() * 1e-15 {
                return None;
            }
            row[j] = pivot.sqrt();
            let row = &*row;
            below.par_chunks_mut(size).with_min_len(ROWS_EACH).for_each(|other| {
                other[j] = (other[j] - dot(&other[..j], &row[..j])) / row[j];
            });
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_system_is_solved_and_one_that_is_not_positive_refused() {
        let size = 75;
        let entry = |i: usize, j: usize| ((i * j) as f64).sin() + if i == j { 75.0 } else { 0.0 };
        let mut matrix = Symmetric::zero(size);
        (0..size).for_each(|i| (0..size).for_each(|j| matrix.add(i, j, entry(i, j))));
        let truth: Vec<f64> = (0..size).map(|i| (i as f64).cos()).collect();
        let right = (0..size).map(|i| (0..size).map(|j| entry(i, j) * truth[j]).sum()).collect();
        let found = matrix.clone().solve(right).unwrap();
        assert!(found.iter().zip(&truth).all(|(a, b)| (a - b).abs() < 1e-12));
        matrix.add(7, 7, -150.0);
        assert!(matrix.solve(truth).is_none());
    }
}
