//! Keyframes with the times of the ways between them, and the film along them.

use super::{CameraPathError, Keyframe, MAX_FRAMES, check_side, motion, read, write};
use crate::camera::Camera;
use std::path::Path;

/// Keyframes and the film along them.
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
    /// Whether a path that is no cycle begins and ends at rest.
    pub eased: bool,
}

/// A path with the times of its keyframes.
struct Timed<'a> {
    path: &'a KeyframePath,
    /// When each way ends, where all take one unit of time.
    ends: Vec<f64>,
}

impl Timed<'_> {
    /// Where the camera is at a part of the whole time.
    fn at(&self, part: f64) -> Option<Keyframe> {
        let (path, keys) = (self.path, &self.path.keyframes);
        if self.ends.is_empty() {
            return keys.first().copied();
        }
        let part = match path.cycle {
            true => part.rem_euclid(1.0),
            false => part.clamp(0.0, 1.0),
        };
        // NaN, and any time of a path without duration, shows the start.
        let part = if part.is_finite() { part } else { 0.0 };
        let index = self.ends.partition_point(|&end| end <= part).min(self.ends.len() - 1);
        let start = index.checked_sub(1).map_or(0.0, |before| self.ends[before]);
        let t = (part - start) / (self.ends[index] - start);
        let key = |index: usize| if path.cycle { keys.get(index % keys.len()) } else { keys.get(index) };
        let before = if path.cycle { key(index + keys.len() - 1) } else { index.checked_sub(1).and_then(key) };
        motion::between([before, key(index), key(index + 1), key(index + 2)], path.eased, t)
    }
}

impl KeyframePath {
    /// Ways between neighbouring keyframes.
    pub(super) fn segments(&self) -> usize {
        let count = self.keyframes.len();
        if self.cycle { count } else { count.saturating_sub(1) }
    }

    /// The keyframe that a way leads to.
    fn goal(&self, segment: usize) -> &Keyframe {
        &self.keyframes[(segment + 1) % self.keyframes.len()]
    }

    fn timed(&self) -> Timed<'_> {
        let (whole, mut done) = (self.whole(), 0.0);
        let ends = (0..self.segments()).map(|segment| {
            done += self.goal(segment).way;
            done / whole
        });
        Timed { path: self, ends: ends.collect() }
    }

    /// When the keyframes are passed, in seconds from the start; in a cycle the first one again after the last.
    pub fn times(&self) -> Vec<f64> {
        let first = (!self.keyframes.is_empty()).then_some(0.0);
        first.into_iter().chain(self.timed().ends).map(|part| self.seconds * part).collect()
    }

    /// When one of them is passed; 0 where there is none.
    pub fn time_of(&self, keyframe: usize) -> f64 {
        self.times().get(keyframe).copied().unwrap_or(0.0)
    }

    /// How long all ways take, in the unit of the keyframes.
    fn whole(&self) -> f64 {
        (0..self.segments()).map(|segment| self.goal(segment).way).sum()
    }

    /// How many seconds the way to each keyframe takes; none to the first one, unless the path is a cycle.
    pub(super) fn ways(&self) -> Vec<Option<f64>> {
        let whole = self.whole();
        let way = |(index, key): (usize, &Keyframe)| {
            ((self.cycle || index > 0) && whole > 0.0).then(|| self.seconds * key.way / whole)
        };
        self.keyframes.iter().enumerate().map(way).collect()
    }

    /// How many seconds the way to one of them takes.
    pub fn way_to(&self, keyframe: usize) -> Option<f64> {
        self.ways().get(keyframe).copied().flatten()
    }

    /// Changes keyframes or whether the path is a cycle. All ways are in seconds then: those that stay take as long as before, and
    /// the film as long as all of them.
    pub fn change(&mut self, change: impl FnOnce(&mut Self)) {
        let factor = self.seconds / self.whole();
        if factor > 0.0 && factor.is_finite() {
            self.keyframes.iter_mut().for_each(|key| key.way *= factor);
        }
        change(self);
        let whole = self.whole();
        if whole > 0.0 {
            self.seconds = whole;
        }
    }

    /// The camera at a time in seconds after the start, or none without keyframes. Before the start and after the end the
    /// camera stands still; a cycle repeats in both directions.
    pub fn camera_at(&self, seconds: f64) -> Option<Camera> {
        Some(self.at(seconds)?.camera(self.width, self.height))
    }

    /// Where the camera is at a time in seconds after the start, as in [`KeyframePath::camera_at`].
    pub fn at(&self, seconds: f64) -> Option<Keyframe> {
        self.timed().at(seconds / self.seconds)
    }

    /// Where the camera is at so many times, evenly from the start to the end.
    pub fn along(&self, count: usize) -> impl Iterator<Item = Keyframe> {
        let timed = self.timed();
        (0..count).filter_map(move |i| timed.at(i as f64 / count.saturating_sub(1).max(1) as f64))
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

    pub(super) fn film(&self) -> impl Iterator<Item = Keyframe> {
        let count = self.frame_count();
        let intervals = if self.cycle { count } else { count.saturating_sub(1).max(1) };
        let timed = self.timed();
        (0..count).filter_map(move |i| timed.at(f64::from(i) / f64::from(intervals)))
    }

    /// Refuses what a film cannot be made of, naming the field as in the file.
    pub(super) fn check(&self) -> Result<(), String> {
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
    /// one. A keyframe with a transition of its own takes that time on the way to it.
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

    /// Writes keyframes and frames, as [`CameraPath::load`](super::CameraPath::load) and nerfstudio read them. A file that is there is
    /// replaced: where the user may not expect it, ask before.
    ///
    /// # Errors
    /// [`CameraPathError::Unsuitable`] for values that [`load`](Self::load) would refuse; [`CameraPathError::Write`].
    pub fn save(&self, path: &Path) -> Result<(), CameraPathError> {
        write::save(self, path)
    }
}
