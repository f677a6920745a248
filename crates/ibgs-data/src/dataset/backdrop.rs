//! Photos of an object that was cut out and laid on one colour, without alpha: which colour, and how much of each pixel the
//! object covers.

use super::decode::decode;
use super::error::{DatasetError, read_bytes};
use super::photos::ListedPhoto;
use super::{ALPHA_EMPTY, Alpha, LoadOptions, Masks, Scene, outside};
use image::{Rgba, RgbaImage};
use rayon::prelude::*;

/// Photos that are looked at, evenly taken from all.
const LOOKED_AT: usize = 12;
/// Least share of such a photo that has the colour exactly, but for [`EXACT`] levels.
const LEAST_SHARE: f64 = 0.15;
/// Largest share: there is an object, and not just a plain picture.
const MOST_SHARE: f64 = 0.98;
/// Least share of its outermost pixels that have the colour, as exactly.
const LEAST_EDGE: f64 = 0.5;
/// Levels that the colours of different photos, and pixels of the backdrop, may differ by.
const EXACT: u8 = 2;
/// Levels that a pixel of the backdrop may differ by where compression has changed it.
const COMPRESSED: u8 = 6;
/// A pixel on the object's edge is a mixture with the backdrop of what lies this far inside.
const INSIDE: i64 = 2;
/// Least difference between object and backdrop, in levels, by which a mixture is measured.
const LEAST_CONTRAST: f64 = 24.0;

fn differs([r, g, b]: [u8; 3], color: [u8; 3]) -> u8 {
    [r, g, b].into_iter().zip(color).map(|(a, b)| a.abs_diff(b)).max().unwrap_or_default()
}

fn rgb(pixel: &Rgba<u8>) -> [u8; 3] {
    [pixel.0[0], pixel.0[1], pixel.0[2]]
}

/// The photos that are looked at.
pub(super) fn some_of(frames: &[ListedPhoto]) -> Vec<&ListedPhoto> {
    frames.iter().step_by(frames.len().div_ceil(LOOKED_AT).max(1)).collect()
}

pub(super) fn edge(photo: &RgbaImage) -> impl Iterator<Item = (u32, u32)> + use<> {
    let (width, height) = photo.dimensions();
    let across = (0..width).flat_map(move |x| [(x, 0), (x, height - 1)]);
    across.chain((0..height).flat_map(move |y| [(0, y), (width - 1, y)]))
}

/// What tells object and surroundings apart.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Behind {
    /// The photo's alpha.
    Alpha,
    /// The colour that the photo lies on.
    Color([u8; 3]),
    /// Nothing: a photo of a whole scene.
    Scene,
}

fn behind(photo: &RgbaImage) -> Behind {
    if photo.pixels().any(|pixel| pixel.0[3] < u8::MAX) {
        return Behind::Alpha;
    }
    let edge: Vec<[u8; 3]> = edge(photo).map(|(x, y)| rgb(photo.get_pixel(x, y))).collect();
    let color = [0, 1, 2].map(|c| {
        let mut levels: Vec<u8> = edge.iter().map(|pixel| pixel[c]).collect();
        let middle = levels.len() / 2;
        *levels.select_nth_unstable(middle).1
    });
    let on_edge = edge.iter().filter(|&&pixel| differs(pixel, color) <= EXACT).count();
    let exact = photo.pixels().filter(|pixel| differs(rgb(pixel), color) <= EXACT).count();
    let share = exact as f64 / (f64::from(photo.width()) * f64::from(photo.height()));
    let is_backdrop = on_edge as f64 >= LEAST_EDGE * edge.len() as f64 && (LEAST_SHARE..=MOST_SHARE).contains(&share);
    if is_backdrop { Behind::Color(color) } else { Behind::Scene }
}

/// The same for all photos, judged by some of them: the alpha of any, or the one colour of all. Masks say it themselves, and are
/// taken for a scene's here.
///
/// # Errors
/// A photo that does not decode.
fn behind_all(frames: &[ListedPhoto], options: &LoadOptions) -> Result<Behind, DatasetError> {
    if frames.is_empty() || frames.iter().any(|frame| frame.mask.is_some()) {
        return Ok(Behind::Scene);
    }
    let some = some_of(frames);
    let look = |frame: &&ListedPhoto| Ok(behind(&decode(&frame.photo, &read_bytes(&frame.photo)?, options)?));
    // Most are told by their first photo.
    let told = look(&some[0])?;
    let Behind::Color(first) = told else { return Ok(told) };
    let others = some[1..].par_iter().map(look).collect::<Result<Vec<_>, DatasetError>>()?;
    let is_one = |other: &Behind| matches!(other, Behind::Color(color) if differs(*color, first) <= EXACT);
    Ok(if others.contains(&Behind::Alpha) {
        Behind::Alpha
    } else if others.iter().all(is_one) {
        Behind::Color(first)
    } else {
        Behind::Scene
    })
}

/// What the photos' alpha and what lies outside of their masks mean, and the colour that an object is shown on: of Blender scenes
/// white, as figures of this field are measured.
pub(super) fn meaning(scene: &Scene, options: &LoadOptions) -> Result<(Alpha, Masks, [u8; 3]), DatasetError> {
    let usual = if scene.of_objects { [255; 3] } else { [0; 3] };
    let frames = &scene.frames;
    Ok(match (options.alpha, options.masks) {
        (Some(alpha @ (Alpha::Mask | Alpha::Composite)), masks) => (alpha, masks.unwrap_or_default(), usual),
        (None, Some(Masks::Object)) => (Alpha::Mask, Masks::Object, usual),
        (given, masks) => match (behind_all(frames, options)?, given) {
            (Behind::Color(color), _) => (Alpha::Keyed, Masks::Ignore, color),
            (_, Some(_)) => {
                let path = scene.listing.clone();
                return Err(DatasetError::NoBackdrop { path });
            }
            (Behind::Alpha, None) if scene.of_objects => (Alpha::Composite, Masks::Ignore, usual),
            _ if masks.is_none() && outside::surrounds_an_object(frames, options)? => {
                (Alpha::Mask, Masks::Object, usual)
            }
            _ => (Alpha::Mask, Masks::Ignore, [0; 3]),
        },
    })
}

/// Sets the alpha of a photo on a backdrop: [`ALPHA_EMPTY`] where the backdrop reaches from the photo's edge, a part where a pixel
/// on the object's edge is a mixture, whose colour becomes that of the object.
pub(super) fn key(photo: &mut RgbaImage, color: [u8; 3]) {
    let empty = reached(photo, color);
    let source = photo.clone();
    let (width, height) = (i64::from(photo.width()), i64::from(photo.height()));
    let around = |x: i64, y: i64, far: i64| {
        let rows = (y - far).max(0)..=(y + far).min(height - 1);
        rows.flat_map(move |row| ((x - far).max(0)..=(x + far).min(width - 1)).map(move |column| (column, row)))
    };
    let is_empty = |(x, y): (i64, i64)| empty[(y * width + x) as usize];
    for y in 0..height {
        for x in 0..width {
            let pixel = photo.get_pixel_mut(x as u32, y as u32);
            if is_empty((x, y)) {
                pixel.0[3] = ALPHA_EMPTY;
            } else if around(x, y, 1).any(is_empty) {
                let inside = around(x, y, INSIDE).filter(|&at| !around(at.0, at.1, 1).any(is_empty));
                let inside: Vec<[u8; 3]> = inside.map(|(x, y)| rgb(source.get_pixel(x as u32, y as u32))).collect();
                *pixel = unmixed(rgb(pixel), &inside, color);
            }
        }
    }
}

/// Which pixels of the backdrop are connected with the photo's edge.
fn reached(photo: &RgbaImage, color: [u8; 3]) -> Vec<bool> {
    let (width, height) = photo.dimensions();
    let mut empty = vec![false; width as usize * height as usize];
    let mut open: Vec<(u32, u32)> = edge(photo).collect();
    while let Some((x, y)) = open.pop() {
        let at = y as usize * width as usize + x as usize;
        if empty[at] || differs(rgb(photo.get_pixel(x, y)), color) > COMPRESSED {
            continue;
        }
        empty[at] = true;
        let beside = [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)];
        open.extend(beside.into_iter().filter(|&(x, y)| x < width && y < height));
    }
    empty
}

/// Colour and alpha of a mixture of the mean of `inside` and the backdrop.
fn unmixed(mixed: [u8; 3], inside: &[[u8; 3]], backdrop: [u8; 3]) -> Rgba<u8> {
    let [r, g, b] = mixed;
    let mean = |c: usize| inside.iter().map(|pixel| f64::from(pixel[c])).sum::<f64>() / inside.len() as f64;
    let contrast: f64 = (0..3).map(|c| (mean(c) - f64::from(backdrop[c])).abs()).fold(0.0, f64::max);
    let difference = f64::from(differs(mixed, backdrop));
    // Without an inside the mean is not a number.
    if inside.is_empty() || contrast < LEAST_CONTRAST || difference >= contrast {
        return Rgba([r, g, b, u8::MAX]);
    }
    let cover = difference / contrast;
    let own = |c: usize| {
        let (mixed, backdrop) = (f64::from(mixed[c]), f64::from(backdrop[c]));
        (backdrop + (mixed - backdrop) / cover).round().clamp(0.0, 255.0) as u8
    };
    let full = f64::from(u8::MAX - ALPHA_EMPTY);
    Rgba([own(0), own(1), own(2), ALPHA_EMPTY + (cover * full).round() as u8])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Photo;

    /// A disc of `object` with soft edges on `backdrop`, a hole of the backdrop's colour inside it.
    fn disc(object: [u8; 3], backdrop: [u8; 3]) -> RgbaImage {
        RgbaImage::from_fn(64, 48, |x, y| {
            let distance = (f64::from(x) - 32.0).hypot(f64::from(y) - 24.0);
            let cover = (14.5 - distance).clamp(0.0, 1.0) * (distance - 3.5).clamp(0.0, 1.0);
            let mix = |c: usize| {
                let (a, b) = (f64::from(object[c]), f64::from(backdrop[c]));
                (a * cover + b * (1.0 - cover)).round() as u8
            };
            Rgba([mix(0), mix(1), mix(2), 255])
        })
    }

    #[test]
    fn a_backdrop_is_found_and_a_scene_is_none() {
        assert_eq!(behind(&disc([200, 120, 40], [0; 3])), Behind::Color([0; 3]));
        assert_eq!(behind(&disc([20, 120, 40], [255; 3])), Behind::Color([255; 3]));
        let scene = RgbaImage::from_fn(64, 48, |x, y| Rgba([(x * 3) as u8, (y * 5) as u8, 90, 255]));
        assert_eq!(behind(&scene), Behind::Scene);
        assert_eq!(behind(&RgbaImage::from_pixel(64, 48, Rgba([90, 120, 150, 255]))), Behind::Scene, "no object");
        let mut masked = disc([200, 120, 40], [0; 3]);
        masked.get_pixel_mut(3, 3).0[3] = 0;
        assert_eq!(behind(&masked), Behind::Alpha, "its alpha says what is empty");
        // Dark, but with the noise of a sensor.
        let noisy = RgbaImage::from_fn(64, 48, |x, y| {
            let v = ((x * 7919 + y * 104_729 + x * y * 31) % 23) as u8;
            Rgba([v, v / 2, v, 255])
        });
        assert_eq!(behind(&noisy), Behind::Scene);
    }

    #[test]
    fn the_object_is_cut_out_with_its_own_colours() {
        for backdrop in [[0; 3], [255; 3], [0, 200, 0]] {
            let photo = disc([200, 120, 40], backdrop);
            let mut cut = photo.clone();
            key(&mut cut, backdrop);
            assert_eq!(cut.get_pixel(2, 2).0[3], ALPHA_EMPTY);
            assert_eq!(cut.get_pixel(32, 24).0[3], 255, "what the edge does not reach is the object");
            assert_eq!(cut.get_pixel(32, 16).0, [200, 120, 40, 255]);
            let soft = cut.pixels().filter(|pixel| (2..255).contains(&pixel.0[3])).count();
            assert!(soft > 40, "{soft}");
            for pixel in cut.pixels().filter(|pixel| (60..255).contains(&pixel.0[3])) {
                assert!(differs(rgb(pixel), [200, 120, 40]) <= 3, "{pixel:?}");
            }
            // Over its backdrop it is the photo.
            let cut = Photo { width: 64, height: 48, rgba: cut.into_raw() };
            let again = cut.over(backdrop.map(|level| f32::from(level) / 255.0));
            for (a, b) in again.rgba.iter().zip(photo.as_raw()) {
                assert!(a.abs_diff(*b) <= COMPRESSED, "{a} {b}");
            }
        }
    }
}
