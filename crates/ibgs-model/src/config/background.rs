//! The colour behind the Gaussians.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// The colour behind the Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Background {
    /// One colour, sRGB.
    Color([u8; 3]),
    /// Another one in each iteration of the training; black in rendered views.
    Random,
}

impl Background {
    /// Nothing is lit.
    pub const BLACK: Self = Self::Color([0; 3]);
    /// As objects are shown by convention.
    pub const WHITE: Self = Self::Color([255; 3]);

    /// The colour behind rendered views.
    pub fn shown(self) -> [u8; 3] {
        match self {
            Self::Color(color) => color,
            Self::Random => [0; 3],
        }
    }
}

ibgs_data::text_in_files!(Background);

impl FromStr for Background {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("`{text}` is none of `white`, `black`, `random`, or `R,G,B` with levels from 0 to 255");
        match text.trim() {
            "white" => Ok(Self::WHITE),
            "black" => Ok(Self::BLACK),
            "random" => Ok(Self::Random),
            levels => {
                let levels: Result<Vec<u8>, _> = levels.split(',').map(|level| level.trim().parse()).collect();
                levels.ok().and_then(|levels| levels.try_into().ok()).map(Self::Color).ok_or_else(wrong)
            }
        }
    }
}

impl fmt::Display for Background {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::BLACK => f.write_str("black"),
            Self::WHITE => f.write_str("white"),
            Self::Random => f.write_str("random"),
            Self::Color([r, g, b]) => write!(f, "{r},{g},{b}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_and_levels_are_read_as_they_are_written() {
        for text in ["white", "black", "random", "1,2,3"] {
            assert_eq!(text.parse::<Background>().unwrap().to_string(), text);
        }
        assert_eq!("255, 255,255".parse(), Ok(Background::WHITE));
        assert_eq!(Background::Random.shown(), [0; 3]);
        for wrong in ["grey", "1,2", "1,2,3,4", "256,0,0", "-1,0,0", "", "1,,2"] {
            let error = wrong.parse::<Background>().unwrap_err();
            assert!(error.contains(&format!("`{wrong}`")) && error.contains("R,G,B"), "{error}");
        }
    }
}
