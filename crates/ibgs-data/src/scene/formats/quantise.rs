//! Quantisation that several formats share.

use super::super::SH_C0;

/// Step of the floats below 1.
pub(super) const FLOAT_STEP: f64 = 1.0 / (1 << 24) as f64;

/// 0 to 1 in whole steps from 0 to `most`.
pub(super) fn unit(value: f64, most: u32) -> u32 {
    (value * f64::from(most)).round().clamp(0.0, f64::from(most)) as u32
}

/// A byte, rounded and clamped.
pub(super) fn byte(value: f64) -> u8 {
    value.round().clamp(0.0, 255.0) as u8
}

/// Opacity, 0 to 1, of a logit.
pub(super) fn opacity(logit: f32) -> f64 {
    1.0 / (1.0 + (-f64::from(logit)).exp())
}

/// The logit of an opacity that was kept in steps of `step`. A value that was rounded to 0 or 1, whose logit is
/// infinite, becomes the middle of the range that rounds to it. NaN stays NaN.
pub(super) fn logit(opacity: f64, step: f64) -> f32 {
    let opacity = if opacity.is_nan() { opacity } else { opacity.clamp(step / 4.0, 1.0 - step / 4.0) };
    (opacity / (1.0 - opacity)).ln() as f32
}

/// Opacity as a byte.
pub(super) fn opacity_byte(value: f32) -> u8 {
    byte(255.0 * opacity(value))
}

/// The logit of an opacity that was kept as a byte.
pub(super) fn logit_of_byte(value: u8) -> f32 {
    logit(f64::from(value) / 255.0, 1.0 / 255.0)
}

/// Colour, 0 to 1 and beyond, of a coefficient of degree 0.
pub(super) fn color(dc: f32) -> f64 {
    0.5 + SH_C0 * f64::from(dc)
}

/// The coefficient of degree 0 of a colour.
pub(super) fn dc(color: f64) -> f32 {
    ((color - 0.5) / SH_C0) as f32
}

/// The logarithm of a standard deviation. 0 counts as the smallest normal float; NaN and negative values give NaN.
pub(super) fn log_scale(scale: f32) -> f32 {
    if scale == 0.0 { f32::MIN_POSITIVE.ln() } else { scale.ln() }
}

/// The quaternion of a file, scaled to length 1; one of length 0 as it is.
pub(super) fn read_quaternion(q: [f32; 4]) -> [f32; 4] {
    if q == [0.0; 4] { q } else { unit_quaternion(q).map(|v| v as f32) }
}

/// The quaternion scaled to length 1; the identity rotation if its length is 0.
pub(super) fn unit_quaternion(q: [f32; 4]) -> [f64; 4] {
    let q = q.map(f64::from);
    let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
    if length == 0.0 { [1.0, 0.0, 0.0, 0.0] } else { q.map(|v| v / length) }
}

/// The place of the largest component of a unit quaternion and the others in their order, with signs for which the largest is
/// positive. They lie within 1 / sqrt(2) of 0.
pub(super) fn smallest_three(q: [f64; 4]) -> (usize, [f64; 3]) {
    let largest = (1..4).fold(0, |best, i| if q[i].abs() > q[best].abs() { i } else { best });
    let sign = q[largest].signum();
    let mut others = (0..4).filter(|&i| i != largest).map(|i| sign * q[i]);
    (largest, std::array::from_fn(|_| others.next().unwrap_or_default()))
}

/// The unit quaternion of [`smallest_three`].
pub(super) fn from_smallest_three(largest: usize, others: [f64; 3]) -> [f32; 4] {
    let rest = 1.0 - others.iter().map(|v| v * v).sum::<f64>();
    let mut others = others.into_iter();
    std::array::from_fn(|i| if i == largest { rest.max(0.0).sqrt() } else { others.next().unwrap_or_default() } as f32)
}

/// w, x, y, z as x, y, z, w.
pub(super) fn scalar_last<T: Copy>([w, x, y, z]: [T; 4]) -> [T; 4] {
    [x, y, z, w]
}

/// x, y, z, w as w, x, y, z.
pub(super) fn scalar_first<T: Copy>([x, y, z, w]: [T; 4]) -> [T; 4] {
    [w, x, y, z]
}
