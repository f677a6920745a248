//! Camera paths as nerfstudio's viewer keeps them: keyframes, the smooth way through them, and the frames of a film.

mod motion;
mod read;
pub mod turntable;
mod write;

use crate::camera::{Camera, MAX_COORDINATE};
use crate::files::WriteError;
use glam::{DMat3, DVec2, DVec3};
use std::f64::consts::PI;
use std::path::{Path, PathBuf};

/// Largest frame side in pixels.
pub const MAX_SIDE: u32 = 16_384;
/// Most frames, and most keyframes, of a path.
pub const MAX_FRAMES: u32 = 1_000_000;

/// Why a camera path cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CameraPathError {
    /// The file cannot be read.
    #[error("cannot read the camera path {}: {source}; check the path", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The file is not a camera path.
    #[error("{} is not a usable camera path: {reason}", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// Field and what is wrong with it.
        reason: String,
    },
    /// The path in memory has values that no file can hold.
    #[error("cannot save the camera path {}: {reason}", path.display())]
    Unsuitable {
        /// The file that was to be written.
        path: PathBuf,
        /// Field and what is wrong with it.
        reason: String,
    },
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
}

/// Cameras of the frames, in order.
#[derive(Clone, Debug)]
pub struct CameraPath {
    /// One camera a frame.
    pub cameras: Vec<Camera>,
    /// Frames a second.
    pub fps: f64,
}

impl CameraPath {
    /// Reads the frames of a camera path as they stand in the file; its keyframes are ignored.
    ///
    /// # Errors
    /// [`CameraPathError`] naming file and field.
    pub fn load(path: &Path) -> Result<Self, CameraPathError> {
        read::load(path, Self::parse)
    }

    /// [`CameraPath::load`] from a file's text.
    ///
    /// # Errors
    /// Field and what is wrong with it.
    pub fn parse(text: &str) -> Result<Self, String> {
        read::parse_frames(text)
    }
}

/// A camera that a path goes through.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Keyframe {
    /// Camera centre in world space.
    pub position: DVec3,
    /// View axes in world space as columns: right, down, forward.
    pub world_from_view: DMat3,
    /// Vertical field of view in radians.
    pub fov: f64,
}

impl Keyframe {
    /// Its camera for an image of this size, the principal point in the middle.
    pub fn camera(&self, width: u32, height: u32) -> Camera {
        let size = DVec2::new(f64::from(width), f64::from(height));
        let view_from_world = self.world_from_view.transpose();
        Camera {
            width,
            height,
            focal: DVec2::splat(0.5 * size.y / (0.5 * self.fov).tan()),
            principal: size / 2.0,
            view_from_world,
            translation: -(view_from_world * self.position),
        }
    }

    fn check(&self) -> Result<(), String> {
        if !self.position.is_finite() || self.position.abs().max_element() > MAX_COORDINATE {
            return Err(format!("the position is {}; its coordinates must lie within 1e12", self.position));
        }
        if rotation(self.world_from_view).is_none() {
            return Err("`world_from_view` is no rotation".to_owned());
        }
        match self.fov > 0.0 && self.fov < PI {
            true => Ok(()),
            false => Err(format!("`fov` is {} degrees; it must lie between 0 and 180", self.fov.to_degrees())),
        }
    }
}

/// The matrix with its columns brought to length one, if they are at right angles then and no mirror image.
fn rotation(matrix: DMat3) -> Option<DMat3> {
    let axes = [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(DVec3::normalize_or_zero);
    let matrix = DMat3::from_cols(axes[0], axes[1], axes[2]);
    ((matrix.determinant() - 1.0).abs() <= 1e-3).then_some(matrix)
}

/// Keyframes, evenly spaced in time, and the film along them.
#[derive(Clone, Debug, PartialEq)]
pub struct KeyframePath {
    /// In the order in which they are passed.
    pub keyframes: Vec<Keyframe>,
    /// Width of a frame in pixels.
    pub width: u32,
    /// Height of a frame in pixels.
    pub height: u32,
    /// Frames a second.
    pub fps: f64,
    /// Duration of the whole film.
    pub seconds: f64,
    /// Whether the path continues from its last keyframe to its first one.
    pub cycle: bool,
}

impl KeyframePath {
    /// Ways between neighbouring keyframes.
    fn segments(&self) -> usize {
        let count = self.keyframes.len();
        if self.cycle { count } else { count.saturating_sub(1) }
    }

    /// When a keyframe is passed, in seconds from the start.
    pub fn time_of(&self, keyframe: usize) -> f64 {
        self.seconds * keyframe as f64 / self.segments().max(1) as f64
    }

    /// The camera at a time in seconds after the start, or none without keyframes. Before the start and after the end the
    /// camera stands still; a cycle repeats in both directions.
    pub fn camera_at(&self, seconds: f64) -> Option<Camera> {
        Some(self.at(seconds)?.camera(self.width, self.height))
    }

    /// Where the camera is at a time in seconds after the start, as in [`KeyframePath::camera_at`].
    pub fn at(&self, seconds: f64) -> Option<Keyframe> {
        let (keys, segments) = (&self.keyframes, self.segments());
        if segments == 0 {
            return keys.first().copied();
        }
        let progress = seconds / self.seconds * segments as f64;
        let progress = match self.cycle {
            true => progress.rem_euclid(segments as f64),
            false => progress.clamp(0.0, segments as f64),
        };
        // NaN, and any time of a path without duration, shows the start.
        let progress = if progress.is_finite() { progress } else { 0.0 };
        let index = (progress as usize).min(segments - 1);
        let key = |index: usize| if self.cycle { keys.get(index % keys.len()) } else { keys.get(index) };
        let before = if self.cycle { key(index + keys.len() - 1) } else { index.checked_sub(1).and_then(key) };
        Some(motion::between(before, key(index)?, key(index + 1)?, key(index + 2), progress - index as f64))
    }

    /// Number of frames of the film: its duration times its rate, at least one and at most [`MAX_FRAMES`]; none
    /// without keyframes.
    pub fn frame_count(&self) -> u32 {
        match self.keyframes.is_empty() {
            true => 0,
            // A cast turns NaN into 0.
            false => ((self.fps * self.seconds).round() as u32).clamp(1, MAX_FRAMES),
        }
    }

    /// Cameras of the film's frames. The first one is the first keyframe's. The last one is the last keyframe's, but
    /// in a cycle it is a frame short of the first keyframe, so that the film can be repeated.
    pub fn frames(&self) -> Vec<Camera> {
        self.film().map(|frame| frame.camera(self.width, self.height)).collect()
    }

    fn film(&self) -> impl Iterator<Item = Keyframe> {
        let count = self.frame_count();
        let intervals = if self.cycle { count } else { count.saturating_sub(1).max(1) };
        (0..count).filter_map(move |i| self.at(self.seconds * f64::from(i) / f64::from(intervals)))
    }

    /// Refuses what a film cannot be made of, naming the field as in the file.
    fn check(&self) -> Result<(), String> {
        check_side("render_width", f64::from(self.width))?;
        check_side("render_height", f64::from(self.height))?;
        for (name, value) in [("fps", self.fps), ("seconds", self.seconds)] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(format!("`{name}` is {value}; it must be a number above 0"));
            }
        }
        let frames = (self.fps * self.seconds).round();
        if frames > f64::from(MAX_FRAMES) {
            return Err(format!("`fps` x `seconds` makes {frames} frames; it must be at most {MAX_FRAMES}"));
        }
        match self.keyframes.len() {
            0 => return Err("it has no keyframes; add one".to_owned()),
            count if count > MAX_FRAMES as usize => {
                return Err(format!("it has {count} keyframes; there must be at most {MAX_FRAMES}"));
            }
            _ => {}
        }
        let mut checks = self.keyframes.iter().enumerate();
        checks.try_for_each(|(i, key)| key.check().map_err(|what| format!("keyframes[{i}]: {what}")))
    }

    /// Reads the keyframes of a camera path. In a file without any, as other programs write it, every frame becomes
    /// one. Keyframes are taken as evenly spaced: nerfstudio's durations of single transitions are not kept.
    ///
    /// # Errors
    /// [`CameraPathError`] naming file and field.
    pub fn load(path: &Path) -> Result<Self, CameraPathError> {
        read::load(path, Self::parse)
    }

    /// [`KeyframePath::load`] from a file's text.
    ///
    /// # Errors
    /// Field and what is wrong with it.
    pub fn parse(text: &str) -> Result<Self, String> {
        read::parse_keyframes(text)
    }

    /// Writes keyframes and frames, as [`CameraPath::load`] and nerfstudio read them. A file that is there is
    /// replaced: where the user may not expect it, ask before.
    ///
    /// # Errors
    /// [`CameraPathError::Unsuitable`] for values that [`load`](Self::load) would refuse; [`CameraPathError::Write`].
    pub fn save(&self, path: &Path) -> Result<(), CameraPathError> {
        write::save(self, path)
    }
}

/// Checks a frame side, which nerfstudio writes as `1080.0` too.
fn check_side(name: &str, side: f64) -> Result<u32, String> {
    match side.fract() == 0.0 && side >= 1.0 && side <= f64::from(MAX_SIDE) {
        true => Ok(side as u32),
        false => Err(format!("`{name}` is {side}; it must be a whole number between 1 and {MAX_SIDE}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::EulerRot;

    pub fn keyframe(position: [f64; 3], turns: [f64; 3], fov: f64) -> Keyframe {
        let world_from_view = DMat3::from_euler(EulerRot::YXZ, turns[0], turns[1], turns[2]);
        Keyframe { position: DVec3::from(position), world_from_view, fov }
    }

    /// Uneven spacing, turns of more than 90 degrees, changing field of view.
    pub fn path(cycle: bool) -> KeyframePath {
        let keyframes = vec![
            keyframe([0.0, 0.0, 0.0], [0.0, 0.1, 0.0], 0.9),
            keyframe([1.0, 0.2, 0.0], [2.0, -0.3, 0.2], 0.9),
            keyframe([1.0, 5.0, -3.0], [-1.9, 0.4, -0.4], 0.4),
            keyframe([-2.0, 5.1, -3.0], [0.3, 1.2, 3.0], 1.4),
            keyframe([-2.0, 0.0, 1.0], [-3.0, -1.2, 0.0], 0.7),
        ];
        KeyframePath { keyframes, width: 64, height: 48, fps: 24.0, seconds: 7.0, cycle }
    }

    /// Largest difference of two cameras in any number, fields of view by their focal lengths.
    pub fn difference(a: &Camera, b: &Camera) -> f64 {
        assert_eq!((a.width, a.height), (b.width, b.height));
        let turn = (a.view_from_world - b.view_from_world).to_cols_array().map(f64::abs);
        let rest = [a.focal - b.focal, a.principal - b.principal].map(|d| d.abs().max_element());
        let shift = (a.center() - b.center()).abs().max_element();
        turn.into_iter().chain(rest).fold(shift, f64::max)
    }

    #[test]
    fn passes_through_its_keyframes_in_time() {
        for cycle in [false, true] {
            let path = path(cycle);
            for (i, key) in path.keyframes.iter().enumerate() {
                let expected = key.camera(64, 48);
                let found = path.camera_at(path.time_of(i)).unwrap();
                assert!(difference(&found, &expected) < 1e-12, "keyframe {i}, cycle {cycle}");
                assert!((found.focal.y - 24.0 / (0.5 * key.fov).tan()).abs() < 1e-12);
            }
        }
        assert_eq!(path(false).time_of(4), 7.0);
        assert_eq!(path(true).time_of(5), 7.0);
    }

    #[test]
    fn a_cycle_ends_where_it_begins() {
        let path = path(true);
        let (start, end) = (path.camera_at(0.0).unwrap(), path.camera_at(7.0 - 1e-9).unwrap());
        assert!(difference(&start, &end) < 1e-6);
        assert!(difference(&start, &path.camera_at(7.0).unwrap()) < 1e-12);
        assert!(difference(&path.camera_at(1.0).unwrap(), &path.camera_at(-6.0).unwrap()) < 1e-12);
        let frames = path.frames();
        assert_eq!(frames.len(), 168);
        assert!(difference(&frames[167], &path.camera_at(7.0 * 167.0 / 168.0).unwrap()) < 1e-12);
    }

    #[test]
    fn an_open_path_stops_at_its_ends() {
        let path = path(false);
        let frames = path.frames();
        assert_eq!((frames.len(), path.frame_count()), (168, 168));
        for (time, keyframe) in [(-1.0, 0), (f64::NEG_INFINITY, 0), (f64::NAN, 0), (8.0, 4), (f64::INFINITY, 4)] {
            let expected = path.keyframes[keyframe].camera(64, 48);
            assert!(difference(&path.camera_at(time).unwrap(), &expected) < 1e-12, "{time}");
        }
        assert!(difference(&frames[0], &path.keyframes[0].camera(64, 48)) < 1e-12);
        assert!(difference(&frames[167], &path.keyframes[4].camera(64, 48)) < 1e-12);
    }

    #[test]
    fn one_keyframe_stands_still_and_none_shows_nothing() {
        for cycle in [false, true] {
            let mut path = path(cycle);
            path.keyframes.truncate(1);
            let expected = path.keyframes[0].camera(64, 48);
            for camera in path.frames() {
                assert!(difference(&camera, &expected) < 1e-12);
            }
            path.seconds = 1e-3;
            assert_eq!(path.frames().len(), 1);
            path.keyframes.clear();
            assert_eq!((path.camera_at(0.0), path.frames().len()), (None, 0));
            assert_eq!(path.time_of(3), 3.0 * path.seconds);
        }
    }

    #[test]
    fn senseless_timing_is_bounded() {
        for cycle in [false, true] {
            let mut path = path(cycle);
            for (fps, seconds) in [(0.0, 1.0), (1.0, 0.0), (f64::NAN, 1.0), (1.0, -1.0), (1.0, f64::NAN)] {
                (path.fps, path.seconds) = (fps, seconds);
                assert_eq!(path.frames().len(), 1, "{fps} {seconds}");
            }
            (path.fps, path.seconds) = (1e300, 1e300);
            assert_eq!(path.frame_count(), MAX_FRAMES);
        }
    }
}
