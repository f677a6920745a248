//! `comment offset X Y Z` in the header of a PLY file: its coordinates are relative to that place.
//!
//! The floats of a PLY hold seven digits: too few for a scene in the coordinates of a map.

use crate::camera::MAX_COORDINATE;
use glam::DVec3;

/// The line of a header; empty without an offset.
pub fn line(offset: Option<DVec3>) -> String {
    offset.map_or_else(String::new, |DVec3 { x, y, z }| format!("comment offset {x} {y} {z}\n"))
}

/// The offset in a header line; none where the line is about something else.
///
/// # Errors
/// What is wrong with the numbers.
pub(crate) fn parse(line: &str) -> Result<Option<DVec3>, String> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let ["comment", "offset", numbers @ ..] = words.as_slice() else { return Ok(None) };
    let values: Vec<f64> = numbers.iter().map_while(|word| word.parse().ok()).collect();
    match (values.as_slice(), numbers.len()) {
        (&[x, y, z], 3) if [x, y, z].iter().all(|v| v.abs() <= MAX_COORDINATE) => Ok(Some(DVec3::new(x, y, z))),
        (&[..], 3) if values.len() == 3 => {
            Err(format!("the offset {} lies beyond {MAX_COORDINATE:e}", numbers.join(" ")))
        }
        // A remark in words.
        _ => Ok(None),
    }
}

/// The offset in a whole header, zero without one.
///
/// # Errors
/// What is wrong with the numbers.
pub fn find(header: &[u8]) -> Result<DVec3, String> {
    for line in header.split(|&byte| byte == b'\n') {
        match parse(&String::from_utf8_lossy(line))? {
            Some(offset) => return Ok(offset),
            None if line.starts_with(b"end_header") => break,
            None => {}
        }
    }
    Ok(DVec3::ZERO)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn offsets_come_back_to_the_last_digit() {
        let offset = DVec3::new(5_234_567.123_456_789, -0.1, 1e-7);
        let header = format!("ply\r\nformat ascii 1.0\r\n{}end_header\ncomment offset 1 2 3\n", line(Some(offset)));
        assert_eq!(find(header.as_bytes()), Ok(offset));
        assert_eq!(find(b"ply\ncomment offset by hand\nend_header\ncomment offset 1 2 3\n"), Ok(DVec3::ZERO));
        assert_eq!(line(None), "");
        for bad in ["NaN 0 0", "0 inf 0", "0 0 1e13"] {
            assert!(find(format!("comment offset {bad}\n").as_bytes()).unwrap_err().contains(bad));
        }
    }
}
