//! Tracks of a scene whose files have none: features of its photos that look alike, where its cameras are roughly known (method.md
//! section 11).

mod chains;
mod features;
mod pairs;

use crate::adjust::{Adjusted, NotAdjusted, Track, adjust, check_count};
use crate::camera::Camera;
use crate::dataset::{DatasetError, HostPhoto};
use crate::progress::Progress;
use features::Features;
use rayon::prelude::*;

/// Adjusts cameras to what their photos have in common, near where the cameras expect it; with the tracks of that.
///
/// # Errors
/// A photo cannot be decoded again. Or, within, too few matches or too many cameras.
pub fn adjust_to_photos(
    given: &[Camera],
    photos: &[&HostPhoto],
    progress: &dyn Progress,
) -> Result<Result<(Adjusted, Vec<Track>), NotAdjusted>, DatasetError> {
    if let Err(too_many) = check_count(given.len()) {
        return Ok(Err(too_many));
    }
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
    let pairs = pairs::chosen(given);
    progress.begin("matching photos", pairs.len());
    let matches = pairs.par_iter().map(|&pair| {
        let matches = pairs::matches(pair.map(|view| &given[view]), pair.map(|view| &found[view]));
        progress.step();
        matches
    });
    let matches: Vec<Vec<[usize; 2]>> = matches.collect();
    progress.end();
    let tracks = chains::joined(&found, &pairs, &matches);
    Ok(adjust(given, &tracks).map(|adjusted| (adjusted, tracks)))
}
