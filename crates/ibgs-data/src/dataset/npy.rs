//! Arrays of numbers as NumPy writes them: a `.npy` file. An `.npz` file is a ZIP archive of such files.
//!
//! The header is a Python dictionary as text: `{'descr': '<f8', 'fortran_order': False, 'shape': (20, 17), }`.

use std::str::FromStr;

const MAGIC: &[u8] = b"\x93NUMPY";

/// An array, its values with the last index running fastest.
#[derive(Debug, PartialEq)]
pub(crate) struct Array {
    pub shape: Vec<usize>,
    pub values: Vec<f64>,
}

/// A type of numbers.
#[derive(Clone, Copy)]
struct Kind {
    big_endian: bool,
    letter: u8,
    size: usize,
}

impl Kind {
    fn parse(text: &str) -> Option<Kind> {
        let (order, rest) = text.split_at_checked(1)?;
        let (letter, size) = rest.split_at_checked(1)?;
        let kind = Kind { big_endian: order == ">", letter: letter.as_bytes()[0], size: size.parse().ok()? };
        let is_known = matches!((kind.letter, kind.size), (b'f', 4 | 8) | (b'i' | b'u', 1 | 2 | 4 | 8));
        (is_known && matches!(order, "<" | ">" | "|" | "=")).then_some(kind)
    }

    fn number(self, bytes: &[u8]) -> f64 {
        let mut raw = [0_u8; 8];
        raw[..self.size].copy_from_slice(bytes);
        if self.big_endian {
            raw[..self.size].reverse();
        }
        let whole = u64::from_le_bytes(raw);
        // The sign stands in the highest bit of the number.
        let unused = 64 - 8 * self.size as u32;
        match (self.letter, self.size) {
            (b'f', 4) => f64::from(f32::from_bits(whole as u32)),
            (b'f', _) => f64::from_bits(whole),
            (b'i', _) => ((whole << unused) as i64 >> unused) as f64,
            _ => whole as f64,
        }
    }
}

/// Reads the contents of a `.npy` file.
///
/// # Errors
/// What is wrong.
pub(crate) fn parse(bytes: &[u8]) -> Result<Array, String> {
    let (header, data) = split(bytes)?;
    let kind = value(header, "descr").ok_or("its header lacks `descr`")?;
    let quoted = kind.strip_prefix(['\'', '"']).ok_or("its values are no plain numbers")?;
    let name: String = quoted.chars().take_while(|c| !matches!(c, '\'' | '"' | ',')).collect();
    let kind = Kind::parse(&name)
        .ok_or_else(|| format!("its values have the type `{name}`; floats and whole numbers are read"))?;
    let by_columns = match value(header, "fortran_order").map(|text| (text.starts_with("True"), text)) {
        Some((true, _)) => true,
        Some((_, text)) if text.starts_with("False") => false,
        _ => return Err("its header lacks `fortran_order`".to_owned()),
    };
    let shape = shape(header).ok_or("its header has no usable `shape`")?;
    let count = shape.iter().try_fold(1_usize, |count, &side| count.checked_mul(side));
    let needed = count.and_then(|count| count.checked_mul(kind.size));
    let Some(data) = needed.and_then(|needed| data.get(..needed)) else {
        return Err(format!("it is truncated: its shape {shape:?} needs more than the {} bytes it has", data.len()));
    };
    let values: Vec<f64> = data.chunks_exact(kind.size).map(|bytes| kind.number(bytes)).collect();
    let values = if by_columns { by_rows(&values, &shape) } else { values };
    Ok(Array { shape, values })
}

/// The text of the header, and what follows it.
fn split(bytes: &[u8]) -> Result<(&str, &[u8]), String> {
    let rest = bytes.strip_prefix(MAGIC).ok_or("it does not begin as an array of NumPy does")?;
    let truncated = || "it is truncated within its header".to_owned();
    let (length, rest) = match rest {
        [1, _, a, b, rest @ ..] => (u32::from_le_bytes([*a, *b, 0, 0]), rest),
        [2 | 3, _, a, b, c, d, rest @ ..] => (u32::from_le_bytes([*a, *b, *c, *d]), rest),
        [1..=3, ..] | [] => return Err(truncated()),
        [version, ..] => return Err(format!("it has version {version} of the format; versions 1 to 3 are read")),
    };
    let (header, data) = rest.split_at_checked(length as usize).ok_or_else(truncated)?;
    Ok((std::str::from_utf8(header).map_err(|_| "its header is no text")?, data))
}

/// What follows a key of the header.
fn value<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    let quoted = [format!("'{key}'"), format!("\"{key}\"")];
    let after = quoted.iter().find_map(|quoted| Some(&header[header.find(quoted.as_str())? + quoted.len()..]))?;
    Some(after.trim_start().strip_prefix(':')?.trim_start())
}

fn shape(header: &str) -> Option<Vec<usize>> {
    let (sides, _) = value(header, "shape")?.strip_prefix('(')?.split_once(')')?;
    let sides = sides.split(',').map(str::trim).filter(|side| !side.is_empty());
    // Python 2 ends whole numbers with an L.
    sides.map(|side| usize::from_str(side.trim_end_matches('L')).ok()).collect()
}

/// Values whose first index runs fastest, in the other order.
fn by_rows(values: &[f64], shape: &[usize]) -> Vec<f64> {
    let at = |mut index: usize| {
        let mut place = 0;
        let mut stride: usize = shape.iter().product();
        for &side in shape.iter().rev() {
            stride /= side;
            place += index % side * stride;
            index /= side;
        }
        place
    };
    (0..values.len()).map(|index| values[at(index)]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(header: &str, data: &[u8]) -> Vec<u8> {
        [MAGIC, &[1, 0], &(header.len() as u16).to_le_bytes(), header.as_bytes(), data].concat()
    }

    fn header(kind: &str, by_columns: bool, shape: &str) -> String {
        let order = if by_columns { "True" } else { "False" };
        format!("{{'descr': '{kind}', 'fortran_order': {order}, 'shape': {shape}, }}   \n")
    }

    #[test]
    fn every_kind_of_numbers_and_order() {
        let values = [-2.0, 3.0, 100.0, 7.0, 0.0, -1.0];
        let expected = Array { shape: vec![2, 3], values: values.to_vec() };
        let bytes = |number: &dyn Fn(f64) -> Vec<u8>| values.iter().flat_map(|&v| number(v)).collect::<Vec<u8>>();
        let cases = [
            ("<f8", bytes(&|v| v.to_le_bytes().to_vec())),
            (">f8", bytes(&|v| v.to_be_bytes().to_vec())),
            ("<f4", bytes(&|v| (v as f32).to_le_bytes().to_vec())),
            (">f4", bytes(&|v| (v as f32).to_be_bytes().to_vec())),
            ("|i1", bytes(&|v| (v as i8).to_le_bytes().to_vec())),
            (">i2", bytes(&|v| (v as i16).to_be_bytes().to_vec())),
            ("<i8", bytes(&|v| (v as i64).to_le_bytes().to_vec())),
        ];
        for (kind, data) in cases {
            assert_eq!(parse(&file(&header(kind, false, "(2, 3)"), &data)).as_ref(), Ok(&expected), "{kind}");
        }
        let columns: Vec<u8> = [0, 3, 1, 4, 2, 5].iter().flat_map(|&i: &usize| values[i].to_le_bytes()).collect();
        assert_eq!(parse(&file(&header("<f8", true, "(2L, 3L)"), &columns)).unwrap(), expected);
        assert_eq!(parse(&file(&header("|u1", false, "(1,)"), &[255])).unwrap().values, [255.0]);
        assert_eq!(parse(&file(&header("|u1", false, "()"), &[9])).unwrap().values, [9.0]);
        assert!(parse(&file(&header("<f8", true, "(0, 3)"), &[])).unwrap().values.is_empty());
    }

    #[test]
    fn damage_is_told() {
        let whole = file(&header("<f4", false, "(2, 2)"), &[0; 16]);
        for end in 0..whole.len() {
            assert!(parse(&whole[..end]).is_err(), "{end}");
        }
        let cases = [
            (header("|O", false, "(2, 2)"), "type `|O`"),
            (header("<f2", false, "(2, 2)"), "type `<f2`"),
            (header("<c16", false, "(1,)"), "type `<c16`"),
            (header("<f4", false, "(2, x)"), "no usable `shape`"),
            (header("<f4", false, "(99999999999, 99999999999)"), "truncated"),
            (header("<f4", false, "(4294967296, 4294967296)"), "truncated"),
            ("{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': (1,)}".to_owned(), "no plain numbers"),
            ("{'descr': '<f4', 'shape': (1,)}".to_owned(), "lacks `fortran_order`"),
            ("{'descr': 'ü'}".to_owned(), "type"),
            ("{}".to_owned(), "lacks `descr`"),
        ];
        for (header, expected) in cases {
            let text = parse(&file(&header, &[0; 16])).unwrap_err();
            assert!(text.contains(expected), "{header}: {text}");
        }
        assert!(parse(b"\x93NUMPY\x09\x00").unwrap_err().contains("version 9"));
        assert!(parse(b"PK\x03\x04").unwrap_err().contains("does not begin"));
    }
}
