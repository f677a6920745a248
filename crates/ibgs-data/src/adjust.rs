//! Cameras and points are adjusted to what the photos have of the points: bundle adjustment (method.md section 11).

mod anchor;
mod normal;
mod reprojection;
mod triangulate;

use crate::camera::{Camera, lenses};
use crate::camera_change::CameraChange;
use crate::median;
use crate::similarity::Similarity;
use anchor::{Anchor, against_next};
use glam::{DVec2, DVec3};
use normal::{Problem, State};
use rayon::prelude::*;
use std::cmp::Reverse;
use triangulate::{INLIER, is_seen, triangulate};

/// A larger system of cameras takes too much memory and time.
const MOST_CAMERAS: usize = 500;
/// Observations of a photo from which on it needs no further tracks, and from which on it is adjusted.
const ENOUGH: usize = 2000;
const FEWEST: usize = 12;
/// Scale of the loss in pixels: the last one, and the first where the cameras are far off.
const SCALE: f64 = 1.0;
const FIRST_SCALE: f64 = 100.0;
/// Steps at a scale, and at the last.
const STEPS: [usize; 2] = [8, 40];
/// Times that the cameras are anchored anew.
const ROUNDS: usize = 2;

/// A photo has a point at a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// Number of the view.
    pub view: usize,
    /// Where, in the undistorted and resized photo.
    pub pixel: DVec2,
}

/// A point that several photos have.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// Where the scene's files have it.
    pub position: Option<DVec3>,
    /// Which photos have it, each once.
    pub seen: Vec<Seen>,
}

/// Cameras and points that fit their observations, in the frame of the cameras as they were given.
#[derive(Clone, Debug)]
pub struct Adjusted {
    /// The cameras.
    pub cameras: Vec<Camera>,
    /// The point of each track, where its photos agree on one.
    pub points: Vec<Option<DVec3>>,
    /// Observations that were compared.
    pub observations: usize,
    /// Their median error in pixels, of the points as they are found: from the given cameras, and from the adjusted ones.
    pub errors: [f64; 2],
    /// What a camera has moved by against those next to it, along an axis: radians, a shift counting by the depth.
    pub alone: f64,
    /// Views that do not fit the others, or have too few observations: their cameras are as they were.
    pub astray: Vec<usize>,
}

/// Why nothing is adjusted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotAdjusted {
    /// Too few views have points in common.
    #[error("too few points are seen by several photos")]
    TooFew,
    /// It would take too long.
    #[error("{0} photos are more than the {MOST_CAMERAS} that are adjusted at a time")]
    TooMany(usize),
}

/// A camera after a change by translation, rotation and the logarithms of the focal lengths.
fn moved(camera: &Camera, [a, b, c, d, e, f, x, y]: [f64; reprojection::NUMBERS]) -> Camera {
    let moved = camera.changed(&CameraChange::from_array([a, b, c, d, e, f, 0.0, 0.0, 0.0, 0.0]));
    Camera { focal: moved.focal * DVec2::new(x.exp(), y.exp()), ..moved }
}

/// Adjusts cameras to the tracks of their photos: poses, and focal lengths that the photos of a lens share. The points begin where
/// the rays of the given cameras meet.
///
/// # Errors
/// Too few observations, or too many cameras.
pub fn adjust(given: &[Camera], tracks: &[Track]) -> Result<Adjusted, NotAdjusted> {
    check_count(given.len())?;
    let chosen = choose(given.len(), tracks);
    let seen: Vec<&[Seen]> = chosen.iter().map(|&track| tracks[track].seen.as_slice()).collect();
    let (lens_of, views_of) = lenses(given);
    let mut state = descended(given, &seen, (&lens_of, &views_of))?;
    anchored(given, &mut state, &seen, (&lens_of, &views_of));
    let errors = errors(&state, &seen);
    let after = median(errors.iter().map(|(_, error)| *error).collect()).ok_or(NotAdjusted::TooFew)?;
    let astray = astray(given.len(), &errors);
    if 2 * astray.len() > given.len() {
        return Err(NotAdjusted::TooFew);
    }
    let mut points = vec![None; tracks.len()];
    chosen.iter().zip(&state.points).for_each(|(&track, point)| points[track] = *point);
    points.par_iter_mut().zip(tracks).filter(|(point, _)| point.is_none()).for_each(|(point, track)| {
        *point = triangulate(&state.cameras, &track.seen, SCALE);
    });
    let (cameras, frame) = aligned(given, state.cameras, &astray);
    points.iter_mut().flatten().for_each(|point| *point = frame.point(*point));
    let state = State { cameras: given.to_vec(), points: chosen.iter().map(|&track| points[track]).collect() };
    let before = middle(&state, &seen).ok_or(NotAdjusted::TooFew)?;
    let [turn, shift] = against_next(given, &cameras, &depths(&state, &seen));
    let alone = turn.hypot(shift);
    Ok(Adjusted { cameras, points, observations: errors.len(), errors: [before, after], alone, astray })
}

/// Where the rays of these cameras meet, for each track; none where its photos agree on no point.
pub fn points(cameras: &[Camera], tracks: &[Track]) -> Vec<Option<DVec3>> {
    tracks.par_iter().map(|track| triangulate(cameras, &track.seen, SCALE)).collect()
}

/// Refuses more cameras than are adjusted at a time.
pub(crate) fn check_count(cameras: usize) -> Result<(), NotAdjusted> {
    if cameras > MOST_CAMERAS { Err(NotAdjusted::TooMany(cameras)) } else { Ok(()) }
}

/// Which tracks of a few cameras fit them at one point, once they are adjusted to all.
pub(crate) fn fitting(given: &[Camera], tracks: &[Track]) -> Vec<bool> {
    let seen: Vec<&[Seen]> = tracks.iter().map(|track| track.seen.as_slice()).collect();
    let (lens_of, views_of) = lenses(given);
    match descended(given, &seen, (&lens_of, &views_of)) {
        Ok(state) => seen.iter().map(|seen| triangulate(&state.cameras, seen, SCALE).is_some()).collect(),
        Err(_) => vec![false; tracks.len()],
    }
}

/// Cameras and points that fit the observations best, whatever the cameras move by.
fn descended(
    given: &[Camera],
    seen: &[&[Seen]],
    (lens_of, views_of): (&[usize], &[usize]),
) -> Result<State, NotAdjusted> {
    let mut scale = FIRST_SCALE;
    let mut state = State { cameras: given.to_vec(), points: vec![None; seen.len()] };
    renew(&mut state, seen, scale);
    scale = (1.5 * middle(&state, seen).ok_or(NotAdjusted::TooFew)?).clamp(SCALE, FIRST_SCALE);
    renew(&mut state, seen, scale);
    loop {
        let problem = Problem { tracks: seen, lens_of, lenses: views_of.len(), scale, anchor: None };
        problem.descend(&mut state, STEPS[usize::from(scale <= SCALE)]);
        if scale <= SCALE {
            return Ok(state);
        }
        scale = (0.5 * scale).max(SCALE);
        renew(&mut state, seen, scale);
    }
}

/// Descends further with the cameras held where they were given, as far as they prove to have been right.
fn anchored(given: &[Camera], state: &mut State, tracks: &[&[Seen]], (lens_of, views_of): (&[usize], &[usize])) {
    let pairs: Vec<_> = state.cameras.iter().copied().zip(given.iter().copied()).collect();
    let frame = Similarity::fit(&pairs);
    state.cameras.iter_mut().for_each(|camera| *camera = frame.camera(camera));
    state.points.iter_mut().flatten().for_each(|point| *point = frame.point(*point));
    let depths = depths(state, tracks);
    for _ in 0..ROUNDS {
        let noise = middle(state, tracks).unwrap_or(0.0);
        let Some(anchor) = Anchor::new(given, (lens_of, views_of), (&state.cameras, &depths), noise) else { return };
        let problem = Problem { tracks, lens_of, lenses: views_of.len(), scale: SCALE, anchor: Some(anchor) };
        problem.descend(state, STEPS[1]);
    }
}

/// The median depth of what each view shows; infinite where it shows nothing.
fn depths(state: &State, tracks: &[&[Seen]]) -> Vec<f64> {
    let mut depths = vec![Vec::new(); state.cameras.len()];
    for (track, point) in tracks.iter().zip(&state.points) {
        let Some(point) = point else { continue };
        track.iter().for_each(|seen| depths[seen.view].push(state.cameras[seen.view].to_view(*point).z));
    }
    let middle = |depths| median(depths).filter(|depth| *depth > 0.0).unwrap_or(f64::INFINITY);
    depths.into_iter().map(middle).collect()
}

/// The tracks that are compared, by number: long ones first, as long as they help a photo that has not enough.
fn choose(views: usize, tracks: &[Track]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..tracks.len()).filter(|&track| tracks[track].seen.len() > 1).collect();
    order.sort_by_key(|&track| Reverse(tracks[track].seen.len()));
    let mut count = vec![0; views];
    order.retain(|&track| {
        let seen = &tracks[track].seen;
        let helps = seen.iter().any(|seen| count[seen.view] < ENOUGH);
        if helps {
            seen.iter().for_each(|seen| count[seen.view] += 1);
        }
        helps
    });
    order
}

/// Points that are not where at least two photos have them are made anew of the rays.
fn renew(state: &mut State, tracks: &[&[Seen]], scale: f64) {
    let State { cameras, points } = state;
    points.par_iter_mut().zip(tracks).for_each(|(point, track)| {
        let kept = point.filter(|point| scale < FIRST_SCALE && is_seen(cameras, track, *point, scale));
        *point = kept.or_else(|| triangulate(cameras, track, scale));
    });
}

/// View and error in pixels of each observation of a point that is known.
fn errors(state: &State, tracks: &[&[Seen]]) -> Vec<(usize, f64)> {
    let known = tracks.iter().zip(&state.points).filter_map(|(track, point)| Some((track, (*point)?)));
    let each = known.flat_map(|(track, point)| track.iter().map(move |seen| (seen, point)));
    each.map(|(seen, point)| {
        let error = reprojection::error(&state.cameras[seen.view], point, seen.pixel);
        (seen.view, error.map_or(reprojection::FAR, DVec2::length))
    })
    .collect()
}

/// The median error in pixels.
fn middle(state: &State, tracks: &[&[Seen]]) -> Option<f64> {
    median(errors(state, tracks).into_iter().map(|(_, error)| error).collect())
}

/// Views whose photos fit no points, or too few.
fn astray(views: usize, errors: &[(usize, f64)]) -> Vec<usize> {
    let mut of_view = vec![Vec::new(); views];
    errors.iter().for_each(|(view, error)| of_view[*view].push(*error));
    let is_astray = |errors: Vec<f64>| {
        let fit = errors.iter().filter(|error| **error < INLIER * SCALE).count();
        fit < FEWEST || median(errors).is_none_or(|error| error > INLIER * SCALE)
    };
    (0..).zip(of_view).filter_map(|(view, errors)| is_astray(errors).then_some(view)).collect()
}

/// Adjusted cameras in the frame of the given ones, which those that are astray keep but for their lens; and the way there.
fn aligned(given: &[Camera], adjusted: Vec<Camera>, astray: &[usize]) -> (Vec<Camera>, Similarity) {
    let fits = |view: &usize| astray.binary_search(view).is_err();
    let pairs: Vec<_> = (0..given.len()).filter(fits).map(|view| (adjusted[view], given[view])).collect();
    let frame = Similarity::fit(&pairs);
    let camera = |(view, camera): (usize, &Camera)| match fits(&view) {
        true => frame.camera(camera),
        false => Camera { focal: camera.focal, ..given[view] },
    };
    (adjusted.iter().enumerate().map(camera).collect(), frame)
}

#[cfg(test)]
mod tests;
