//! Colours of PLY files: the names of their fields, and which number is white.

/// Names under which a vertex may have its colour, the usual ones first.
pub const NAMES: [[&str; 3]; 3] =
    [["red", "green", "blue"], ["diffuse_red", "diffuse_green", "diffuse_blue"], ["r", "g", "b"]];

/// What is white where the largest channel of all colours, kept as floats, is `largest`: 1, or the largest number of 8 or 16
/// bits. Colours may reach a little beyond white.
pub fn white_of_floats(largest: f64) -> f64 {
    match largest {
        ..=2.0 => 1.0,
        ..=510.0 => 255.0,
        _ => 65535.0,
    }
}
