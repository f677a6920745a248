//! A strip below a depth picture: its colours with the depths that they stand for.

use super::{Picture, viridis};

/// Rows of a glyph; its lowest three bits are the columns, the left one highest.
const GLYPHS: [(char, [u8; 5]); 14] = [
    ('0', [7, 5, 5, 5, 7]),
    ('1', [2, 6, 2, 2, 7]),
    ('2', [7, 1, 7, 4, 7]),
    ('3', [7, 1, 7, 1, 7]),
    ('4', [5, 5, 7, 1, 1]),
    ('5', [7, 4, 7, 1, 7]),
    ('6', [7, 4, 7, 5, 7]),
    ('7', [7, 1, 1, 1, 1]),
    ('8', [7, 5, 7, 5, 7]),
    ('9', [7, 5, 7, 1, 7]),
    ('.', [0, 0, 0, 0, 2]),
    ('-', [0, 0, 7, 0, 0]),
    ('+', [0, 2, 7, 2, 0]),
    ('e', [0, 7, 7, 4, 7]),
];

/// Pixels from one glyph to the next, at scale 1.
const ADVANCE: u32 = 4;
/// Numbers along the bar.
const LABELS: u32 = 5;

/// Three significant digits.
fn label(value: f32) -> String {
    if value != 0.0 && !(1e-3..1e5).contains(&value.abs()) {
        return format!("{value:.1e}");
    }
    let digits = if value == 0.0 { 0 } else { value.abs().log10().floor() as i32 };
    let decimals = usize::try_from((2 - digits).max(0)).unwrap_or(0);
    format!("{value:.decimals$}")
}

/// The picture with a bar below it, nearest on the left.
pub(super) fn below(mut picture: Picture, [near, far]: [f32; 2]) -> Picture {
    let scale = (picture.width / 320).max(1);
    let (bar, strip) = (6 * scale, 14 * scale);
    let (width, top) = (picture.width, picture.height);
    picture.height += strip;
    picture.rgb.resize((3 * width * picture.height) as usize, 0);
    let last = width.saturating_sub(1).max(1);
    for y in top..top + bar {
        for x in 0..width {
            let at = 3 * (y * width + x) as usize;
            picture.rgb[at..at + 3].copy_from_slice(&viridis(1.0 - x as f32 / last as f32));
        }
    }
    let mut free_from = 0;
    for i in 0..LABELS {
        let t = i as f32 / (LABELS - 1) as f32;
        let text = label(near + (far - near) * t);
        let length = (text.len() as u32 * ADVANCE - 1) * scale;
        // Centred under its colour, but inside; left out where it would touch the one before.
        let x = ((t * last as f32) as u32).saturating_sub(length / 2).min(width.saturating_sub(length));
        if x >= free_from && x + length <= width {
            write(&mut picture, &text, x, top + bar + 2 * scale, scale);
            free_from = x + length + 3 * scale;
        }
    }
    picture
}

fn write(picture: &mut Picture, text: &str, left: u32, top: u32, scale: u32) {
    for (i, c) in (0..).zip(text.chars()) {
        let Some((_, rows)) = GLYPHS.iter().find(|(name, _)| *name == c) else {
            continue;
        };
        for (y, x) in (0..5 * scale).flat_map(|y| (0..3 * scale).map(move |x| (y, x))) {
            if rows[(y / scale) as usize] >> (2 - x / scale) & 1 == 1 {
                let at = 3 * ((top + y) * picture.width + left + i * ADVANCE * scale + x) as usize;
                picture.rgb[at..at + 3].fill(255);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn labels_have_three_digits() {
        let cases = [
            (0.0, "0.00"),
            (0.0123, "0.0123"),
            (1.0, "1.00"),
            (12.345, "12.3"),
            (123.4, "123"),
            (99_999.0, "99999"),
            (2e6, "2.0e6"),
            (1e-5, "1.0e-5"),
        ];
        for (value, expected) in cases {
            assert_eq!(super::label(value), expected);
        }
    }
}
