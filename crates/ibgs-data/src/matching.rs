//! Tracks of a scene whose files have none: features of its photos that look alike, where its cameras are roughly known (method.md
//! section 11).

mod chains;
mod features;
mod pairs;

use crate::adjust::{Adjusted, NotAdjusted, Track, adjust};
use crate::camera::Camera;
use crate::dataset::{DatasetError, HostPhoto};
use crate::progress::Progress;
use features::Features;
use pairs::Search;
use rayon::prelude::*;

/// How places are looked for where the cameras may be far off, and where they have been adjusted once.
const WIDE: Search = Search { off: 0.06, ratio: 0.8 };
const NARROW: Search = Search { off: 0.01, ratio: 0.9 };

/// Adjusts cameras to what their photos have in common: to matches near where the cameras expect them, then to those near where the
/// adjusted cameras do. With the tracks of the latter.
///
/// # Errors
/// A photo cannot be decoded again. Or, within, too few matches or too many cameras.
pub fn adjust_to_photos(
    given: &[Camera],
    photos: &[&HostPhoto],
    progress: &dyn Progress,
) -> Result<Result<(Adjusted, Vec<Track>), NotAdjusted>, DatasetError> {
    progress.begin("finding features", photos.len());
    let found: Result<Vec<Features>, DatasetError> = photos
        .par_iter()
        .map(|photo| {
            let found = Features::of(&*photo.pixels()?);
            progress.step();
            Ok(found)
        })
        .collect();
    progress.end();
    let found = found?;
    Ok(adjust(given, &tracks(given, &found, &WIDE, progress)).and_then(|rough| {
        let tracks = tracks(&rough.cameras, &found, &NARROW, progress);
        Ok((adjust(given, &tracks)?, tracks))
    }))
}

/// What the photos of these cameras have in common.
fn tracks(cameras: &[Camera], found: &[Features], search: &Search, progress: &dyn Progress) -> Vec<Track> {
    let pairs = pairs::chosen(cameras);
    progress.begin("matching photos", pairs.len());
    let matches = pairs.par_iter().map(|&pair| {
        let matches = pairs::matches(pair.map(|view| &cameras[view]), pair.map(|view| &found[view]), search);
        progress.step();
        matches
    });
    let matches: Vec<Vec<[usize; 2]>> = matches.collect();
    progress.end();
    chains::joined(found, &pairs, &matches)
}
