//! Options as text. The words of an enum are those of its serde derive, which files, messages and command lines all take.

use serde::de::{self, DeserializeOwned, Deserializer, Visitor};
use serde::forward_to_deserialize_any;
use std::fmt;

/// The words that an enum is read from, in the order of its variants.
pub fn words<T: DeserializeOwned>() -> &'static [&'static str] {
    T::deserialize(Asked).err().map_or(&[], |Words(words)| words)
}

/// A number such as `5000`, `100k` or `1.5M`; none for other text.
pub fn number(text: &str) -> Option<f64> {
    let lower = text.trim().to_ascii_lowercase();
    let (number, factor) = match (lower.strip_suffix('k'), lower.strip_suffix('m')) {
        (Some(number), _) => (number, 1e3),
        (_, Some(number)) => (number, 1e6),
        _ => (lower.as_str(), 1.0),
    };
    let value = number.parse::<f64>().ok()? * factor;
    // 4.1 times a million is a little less than 4,100,000.
    let whole = value.round();
    ((value - whole).abs() <= 1e-9 * whole).then_some(whole)
}

/// The same as a count from 1.
pub fn count(text: &str) -> Option<u32> {
    number(text).filter(|count| (1.0..=f64::from(u32::MAX)).contains(count)).map(|count| count as u32)
}

/// Writes enums as their words.
macro_rules! display_words {
    ($($name:ty),+) => {
        $(impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                serde::Serialize::serialize(self, f)
            }
        })+
    };
}

pub(crate) use display_words;

/// Lets a type with `FromStr` and `Display` stand as its text in files, for `#[serde(try_from = "String", into = "String")]`.
#[macro_export]
macro_rules! text_in_files {
    ($name:ty) => {
        impl TryFrom<String> for $name {
            type Error = <$name as std::str::FromStr>::Err;

            fn try_from(text: String) -> Result<Self, Self::Error> {
                text.parse()
            }
        }

        impl From<$name> for String {
            fn from(value: $name) -> String {
                value.to_string()
            }
        }
    };
}

/// Gives no value: it is asked for an enum and learns its words.
struct Asked;

/// What it learned.
#[derive(Debug)]
struct Words(&'static [&'static str]);

impl fmt::Display for Words {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.0)
    }
}

impl std::error::Error for Words {}

impl de::Error for Words {
    fn custom<T: fmt::Display>(_: T) -> Self {
        Self(&[])
    }
}

impl<'de> Deserializer<'de> for Asked {
    type Error = Words;

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        words: &'static [&'static str],
        _: V,
    ) -> Result<V::Value, Words> {
        Err(Words(words))
    }

    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, Words> {
        Err(Words(&[]))
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf option unit unit_struct
        newtype_struct seq tuple tuple_struct map struct identifier ignored_any
    }
}

#[cfg(test)]
mod tests {
    use super::words;
    use crate::dataset::{InitialPoints, PrincipalPoint, Resolution};

    #[test]
    fn words_are_those_of_the_files() {
        assert_eq!(words::<InitialPoints>(), ["auto", "scene", "photos", "random"]);
        assert_eq!(words::<PrincipalPoint>(), [PrincipalPoint::True, PrincipalPoint::Centred].map(|p| p.to_string()));
        assert_eq!(words::<Resolution>(), [""; 0], "no enum in a file");
    }
}
