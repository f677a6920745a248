//! Camera paths as nerfstudio's viewer keeps them: keyframes, the smooth way through them, and the frames of a film.

mod keyframes;
mod motion;
mod read;
pub mod turntable;
mod write;

pub use keyframes::KeyframePath;

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
    /// How long the way to it takes, relative to the other ways; usually 1.
    pub way: f64,
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
        if !(self.fov > 0.0 && self.fov < PI) {
            return Err(format!("`fov` is {} degrees; it must lie between 0 and 180", self.fov.to_degrees()));
        }
        match self.way > 0.0 && self.way.is_finite() {
            true => Ok(()),
            false => Err(format!("the way to it takes {}; it must take a time above 0", self.way)),
        }
    }
}

/// The matrix with its columns brought to length one, if they are at right angles then and no mirror image.
fn rotation(matrix: DMat3) -> Option<DMat3> {
    let axes = [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(DVec3::normalize_or_zero);
    let matrix = DMat3::from_cols(axes[0], axes[1], axes[2]);
    ((matrix.determinant() - 1.0).abs() <= 1e-3).then_some(matrix)
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
        Keyframe { position: DVec3::from(position), world_from_view, fov, way: 1.0 }
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
        KeyframePath { keyframes, width: 64, height: 48, fps: 24.0, seconds: 7.0, cycle, eased: false }
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
            assert_eq!(path.time_of(3), 0.0);
        }
    }

    #[test]
    fn a_way_may_take_longer_than_others() {
        for cycle in [false, true] {
            let mut path = path(cycle);
            let usual = path.way_to(1).unwrap();
            assert!((usual - 7.0 / if cycle { 5.0 } else { 4.0 }).abs() < 1e-12);
            path.change(|path| path.keyframes[2].way = usual + 3.0);
            assert!((path.seconds - 10.0).abs() < 1e-12);
            for (i, key) in path.keyframes.iter().enumerate() {
                let found = path.camera_at(path.time_of(i)).unwrap();
                assert!(difference(&found, &key.camera(64, 48)) < 1e-9, "keyframe {i}, cycle {cycle}");
                let expected = if i < 2 { i as f64 * usual } else { i as f64 * usual + 3.0 };
                assert!((path.time_of(i) - expected).abs() < 1e-9, "{}", path.time_of(i));
            }
            // No jump of the speed where a slow way meets a quick one.
            let speed = |from: f64| {
                let place = |time: f64| path.at(time).unwrap().position;
                (place(from + 1e-6) - place(from)) / 1e-6
            };
            for i in [1, 2, 3] {
                let at = path.time_of(i);
                assert!(speed(at - 1e-6).distance(speed(at)) < 1e-3 * speed(at).length(), "keyframe {i}");
            }
            assert_eq!(path.way_to(0).is_some(), cycle);
            // A new keyframe adds its way.
            path.change(|path| path.keyframes.push(Keyframe { way: 2.0, ..path.keyframes[1] }));
            assert!((path.seconds - 12.0).abs() < 1e-9);
            let file = write::text(&path).unwrap();
            let read = KeyframePath::parse(&file).unwrap();
            assert!((0..6).all(|i| (read.time_of(i) - path.time_of(i)).abs() < 1e-9), "as the file has it");
        }
    }

    #[test]
    fn a_slow_way_after_a_quick_one_does_not_overshoot() {
        let keyframes = [0.0, 1.0, 2.0].map(|x| keyframe([x, 0.0, 0.0], [x, 0.0, 0.0], 0.9)).to_vec();
        let mut path = KeyframePath { keyframes, seconds: 4.0, ..path(false) };
        path.change(|path| path.keyframes[2].way = 60.0);
        let places: Vec<f64> = path.along(1_000).map(|key| key.position.x).collect();
        assert!(places.windows(2).all(|pair| pair[0] <= pair[1] + 1e-9), "it never turns back");
    }

    #[test]
    fn an_eased_path_begins_and_ends_at_rest() {
        let mut path = path(false);
        let speed = |path: &KeyframePath, from: f64| {
            path.at(from + 1e-4).unwrap().position.distance(path.at(from).unwrap().position) / 1e-4
        };
        let ends = [0.0, 7.0 - 1e-4];
        assert!(ends.iter().all(|&end| speed(&path, end) > 0.05));
        path.eased = true;
        assert!(ends.iter().all(|&end| speed(&path, end) < 1e-2), "{:?}", ends.map(|end| speed(&path, end)));
        assert_eq!(path.along(3).count(), 3);
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
