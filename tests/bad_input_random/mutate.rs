//! Damage to a file: bits, bytes, cuts, splices, numbers that lie.

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::{Index, select};

/// One damage.
#[derive(Clone, Debug)]
pub enum Damage {
    Flip(Index, u8),
    Byte(Index, u8),
    Cut(Index),
    Drop(Index, u8),
    Insert(Index, Vec<u8>),
    /// A part of the file put somewhere else in it.
    Splice(Index, Index, u8),
    /// An integer of 2, 4 or 8 bytes, little or big endian.
    Integer(Index, u64, usize, bool),
    /// The number or word in a text that stands nearest after a place.
    Word(Index, &'static str),
}

/// Values at which sums, products and signs go wrong.
const INTEGERS: [u64; 14] = [
    0,
    1,
    0x7f,
    0xff,
    0x7fff,
    0xffff,
    0x7fff_ffff,
    0xffff_ffff,
    1 << 32,
    1 << 40,
    1 << 60,
    i64::MAX as u64,
    u64::MAX / 24,
    u64::MAX,
];

const WORDS: [&str; 38] = [
    "0",
    "-1",
    "1",
    "255",
    "256",
    "65536",
    "4294967295",
    "4294967296",
    "1152921504606846976",
    "9223372036854775807",
    "18446744073709551615",
    "99999999999999999999999",
    "1e12",
    "1e-320",
    "1e38",
    "1e39",
    "1e300",
    "-1e300",
    "1e308",
    "1e999",
    "NaN",
    "nan",
    "inf",
    "-inf",
    "null",
    "true",
    "[]",
    "{}",
    "\"\"",
    "\"x\"",
    "\"../a.png\"",
    "\"/etc/passwd\"",
    "..\\..\\a",
    "C:/a",
    "\u{1b}[2J",
    "\u{202e}",
    "\"\\ud800\"",
    "[[[[[[[[",
];

fn damage() -> impl Strategy<Value = Damage> {
    let at = any::<Index>;
    prop_oneof![
        1 => (at(), 0..8_u8).prop_map(|(at, bit)| Damage::Flip(at, bit)),
        1 => (at(), any::<u8>()).prop_map(|(at, byte)| Damage::Byte(at, byte)),
        1 => at().prop_map(Damage::Cut),
        1 => (at(), any::<u8>()).prop_map(|(at, count)| Damage::Drop(at, count)),
        1 => (at(), vec(any::<u8>(), 1..40)).prop_map(|(at, bytes)| Damage::Insert(at, bytes)),
        1 => (at(), at(), any::<u8>()).prop_map(|(from, to, count)| Damage::Splice(from, to, count)),
        1 => (at(), select(&INTEGERS[..]), select(&[2, 4, 8][..]), any::<bool>())
            .prop_map(|(at, value, size, big)| Damage::Integer(at, value, size, big)),
        3 => (at(), select(&WORDS[..])).prop_map(|(at, word)| Damage::Word(at, word)),
    ]
}

/// A few damages.
pub fn damages() -> impl Strategy<Value = Vec<Damage>> {
    vec(damage(), 1..5)
}

/// The file after the damages; its first `keep` bytes stay.
pub fn damaged(file: &[u8], keep: usize, damages: &[Damage]) -> Vec<u8> {
    let (head, body) = file.split_at(keep);
    let mut bytes = body.to_vec();
    for damage in damages {
        apply(&mut bytes, damage);
    }
    [head, &bytes].concat()
}

fn apply(bytes: &mut Vec<u8>, damage: &Damage) {
    let end = bytes.len();
    // One place more than there are bytes: the end.
    let place = |at: &Index| at.index(end + 1);
    match damage {
        Damage::Flip(at, bit) => {
            if let Some(byte) = bytes.get_mut(place(at)) {
                *byte ^= 1 << bit;
            }
        }
        Damage::Byte(at, value) => {
            if let Some(byte) = bytes.get_mut(place(at)) {
                *byte = *value;
            }
        }
        Damage::Cut(at) => bytes.truncate(place(at)),
        Damage::Drop(at, count) => {
            let from = place(at);
            bytes.drain(from..end.min(from + usize::from(*count)));
        }
        Damage::Insert(at, inserted) => {
            let at = place(at);
            bytes.splice(at..at, inserted.iter().copied());
        }
        Damage::Splice(from, to, count) => {
            let (from, to) = (place(from), place(to));
            let part = bytes[from..end.min(from + usize::from(*count))].to_vec();
            bytes.splice(to..to, part);
        }
        Damage::Integer(at, value, size, big) => {
            let little = value.to_le_bytes();
            let mut integer = little[..*size].to_vec();
            if *big {
                integer.reverse();
            }
            let from = place(at);
            for (byte, new) in bytes.iter_mut().skip(from).zip(integer) {
                *byte = new;
            }
        }
        Damage::Word(at, word) => {
            let is_word = |byte: &u8| byte.is_ascii_alphanumeric() || b"._-+\"".contains(byte);
            let from = place(at);
            let begin = from + bytes[from..].iter().position(is_word).unwrap_or(0);
            let length = bytes[begin..].iter().position(|byte| !is_word(byte)).unwrap_or(end - begin);
            bytes.splice(begin..begin + length, word.bytes());
        }
    }
}
