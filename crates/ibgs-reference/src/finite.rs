//! Central finite differences in double precision.

use rayon::prelude::*;

/// Steps tried in turn. A small one keeps away from the thresholds of the blending, a large one from rounding.
const STEPS: [f64; 5] = [1e-5, 1e-4, 1e-6, 1e-3, 1e-7];

/// (f(x + h e_i) - f(x - h e_i)) / 2h.
pub fn central_difference(at: &[f64], i: usize, step: f64, f: &impl Fn(&[f64]) -> f64) -> f64 {
    let moved = |by: f64| {
        let mut x = at.to_vec();
        x[i] += by;
        f(&x)
    };
    (moved(step) - moved(-step)) / (2.0 * step)
}

/// Holds every entry of `gradient` against central differences of `f` and returns the worst error, relative to the
/// entry or to a thousandth of the tensor's largest one. An entry passes when one step size agrees: a wrong gradient
/// agrees at none, a threshold crossed by a step only spoils that step.
pub fn assert_gradient(
    name: &str,
    at: &[f64],
    gradient: &[f64],
    tolerance: f64,
    f: impl Fn(&[f64]) -> f64 + Sync,
) -> f64 {
    assert_eq!(at.len(), gradient.len(), "{name}: length of the gradient");
    let largest = gradient.iter().fold(0.0, |a: f64, b| a.max(b.abs()));
    assert!(largest > 0.0, "{name}: the gradient is zero everywhere");
    let entry_error = |i: usize| {
        let scale = gradient[i].abs().max(1e-3 * largest);
        let mut best = f64::INFINITY;
        let mut nearest = f64::NAN;
        for step in STEPS {
            let difference = central_difference(at, i, step, &f);
            let error = (difference - gradient[i]).abs() / scale;
            if error < best {
                (best, nearest) = (error, difference);
            }
            if best <= tolerance {
                return best;
            }
        }
        panic!("{name}[{i}]: gradient {:e}, finite difference {nearest:e}, relative error {best:e}", gradient[i]);
    };
    let errors: Vec<f64> = (0..at.len()).into_par_iter().map(entry_error).collect();
    errors.into_iter().fold(0.0, f64::max)
}
