//! Lists of counts and image sizes on the command line.

use anyhow::{Result, bail};
use ibgs_core::words::number;

/// Largest image side in pixels.
const MAX_SIDE: u32 = 16_384;
/// Largest number of Gaussians of a synthetic scene.
const MOST_GAUSSIANS: f64 = 5e7;
/// Sizes with a name.
const NAMED: [(&str, [u32; 2]); 5] = [
    ("540p", [960, 540]),
    ("720p", [1280, 720]),
    ("1080p", [1920, 1080]),
    ("1440p", [2560, 1440]),
    ("4k", [3840, 2160]),
];

/// Numbers such as `5000`, `100k` or `1.5M`, separated by commas.
pub fn counts(text: &str) -> Result<Vec<usize>> {
    text.split(',').map(count).collect()
}

/// Widths and heights such as `1600x1064` or `1080p`, separated by commas.
pub fn sizes(text: &str) -> Result<Vec<[u32; 2]>> {
    text.split(',').map(size).collect()
}

fn count(text: &str) -> Result<usize> {
    match number(text) {
        Some(value) if (1.0..=MOST_GAUSSIANS).contains(&value) => Ok(value as usize),
        _ => bail!("option `--gaussians` is `{text}`; write it as 5000, 100k or 1.5M, from 1 to {MOST_GAUSSIANS}"),
    }
}

fn size(text: &str) -> Result<[u32; 2]> {
    let lower = text.trim().to_ascii_lowercase();
    if let Some((_, size)) = NAMED.iter().find(|(name, _)| *name == lower) {
        return Ok(*size);
    }
    let side = |text: &str| text.parse().ok().filter(|side| (1..=MAX_SIDE).contains(side));
    match lower.split_once('x').and_then(|(width, height)| Some([side(width)?, side(height)?])) {
        Some(size) => Ok(size),
        None => {
            let names = NAMED.map(|(name, _)| name).join(", ");
            bail!("option `--size` is `{text}`; write it as WIDTHxHEIGHT, each from 1 to {MAX_SIDE}, or as {names}")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_have_suffixes() {
        assert_eq!(counts("5,100k,1.5M,4.1M,2.01k").unwrap(), [5, 100_000, 1_500_000, 4_100_000, 2_010]);
        for text in ["", "0", "-5", "1.5", "k", "1,,2", "60M", "nan"] {
            assert!(counts(text).is_err(), "{text}");
        }
    }

    #[test]
    fn sizes_have_names() {
        assert_eq!(sizes("33x24,1080p,4K").unwrap(), [[33, 24], [1920, 1080], [3840, 2160]]);
        for text in ["", "64", "0x5", "5x", "99999x5", "12x4xabc", "480p"] {
            assert!(sizes(text).is_err(), "{text}");
        }
    }
}
