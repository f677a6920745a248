//! What lies outside of masks, where nobody says it: nothing, if they leave one object.

use super::LoadOptions;
use super::backdrop::{edge, some_of};
use super::decode::{Drops, apply_mask, decode};
use super::error::{DatasetError, read_bytes};
use super::photos::ListedPhoto;
use image::RgbaImage;
use rayon::prelude::*;

/// A pixel of less alpha is masked.
const MASKED_UNDER: u8 = 128;
/// Least share of a photo's outermost pixels that an object's mask drops. The object may reach past the photo on one side.
const LEAST_EDGE: f64 = 0.7;
/// Share of a photo that an object fills.
const OBJECT: std::ops::RangeInclusive<f64> = 0.01..=0.85;
/// The masks of two photos are the same lens's where no more of the kept part than this differs.
const SAME: f64 = 0.01;
/// Cells of a photo's sides that masks are compared by.
const CELLS: u32 = 96;

/// Which cells of a photo its mask keeps; none where it does not surround them.
fn kept(photo: &RgbaImage) -> Option<Vec<bool>> {
    let is_kept = |x, y| photo.get_pixel(x, y).0[3] >= MASKED_UNDER;
    let outermost: Vec<bool> = edge(photo).map(|(x, y)| is_kept(x, y)).collect();
    let dropped = outermost.iter().filter(|kept| !**kept).count() as f64 / outermost.len() as f64;
    let (width, height) = photo.dimensions();
    let at = |cell: u32, side: u32| ((2 * cell + 1) * side / (2 * CELLS)).min(side - 1);
    let cells: Vec<bool> = (0..CELLS * CELLS).map(|i| is_kept(at(i % CELLS, width), at(i / CELLS, height))).collect();
    let share = cells.iter().filter(|kept| **kept).count() as f64 / cells.len() as f64;
    (dropped >= LEAST_EDGE && OBJECT.contains(&share)).then_some(cells)
}

fn differ(a: &[bool], b: &[bool]) -> bool {
    let different = a.iter().zip(b).filter(|(a, b)| a != b).count();
    different as f64 > SAME * a.iter().filter(|kept| **kept).count() as f64
}

/// Whether the masks (files, or alpha channels) of all photos leave one object each: they drop what surrounds it, and are not all
/// the same, as those of a lens are. Judged by some of the photos.
///
/// # Errors
/// A photo or a mask that does not decode, or does not fit.
pub(super) fn surrounds_an_object(frames: &[ListedPhoto], options: &LoadOptions) -> Result<bool, DatasetError> {
    let has_files = frames.iter().filter(|frame| frame.mask.is_some()).count();
    if has_files != 0 && has_files != frames.len() {
        return Ok(false);
    }
    let look = |frame: &&ListedPhoto| {
        let mut photo = decode(&frame.photo, &read_bytes(&frame.photo)?, options)?;
        if let Some(mask) = &frame.mask {
            apply_mask(&mut photo, (&frame.photo, mask), Drops::ByBrightness)?;
        }
        Ok(kept(&photo))
    };
    let some = some_of(frames);
    // Most are told by their first photo.
    let Some(first) = some.first().map(look).transpose()?.flatten() else { return Ok(false) };
    let others = some[1..].par_iter().map(look).collect::<Result<Vec<_>, DatasetError>>()?;
    let all: Option<Vec<Vec<bool>>> = others.into_iter().collect();
    Ok(all.is_some_and(|all| all.iter().any(|other| differ(&first, other))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgba;

    fn masked(is_kept: impl Fn(f64, f64) -> bool) -> RgbaImage {
        let alpha = |x: u32, y: u32| if is_kept(f64::from(x) / 63.0, f64::from(y) / 47.0) { 255 } else { 0 };
        RgbaImage::from_fn(64, 48, |x, y| Rgba([90, 120, 150, alpha(x, y)]))
    }

    fn disc(at: f64, radius: f64) -> RgbaImage {
        masked(|x, y| (x - at).hypot(y - 0.5) < radius)
    }

    #[test]
    fn an_object_is_what_a_mask_leaves_in_the_middle() {
        assert!(kept(&disc(0.5, 0.3)).is_some());
        assert!(kept(&disc(0.9, 0.3)).is_some(), "it may reach past one side");
        let others: [(&str, RgbaImage); 5] = [
            ("nothing dropped", masked(|_, _| true)),
            ("all dropped", masked(|_, _| false)),
            ("a passer-by", masked(|x, y| (x - 0.5).hypot(y - 0.6) > 0.3)),
            ("the sky", masked(|_, y| y > 0.5)),
            ("a dot", disc(0.5, 0.02)),
        ];
        for (name, photo) in others {
            assert!(kept(&photo).is_none(), "{name}");
        }
        let [a, b, c] = [0.5, 0.5, 0.55].map(|at| kept(&disc(at, 0.3)).unwrap());
        assert!(!differ(&a, &b) && differ(&a, &c));
    }
}
