//! The camera path in work, and its preview.

use crate::View;
use crate::navigator::Navigator;
use eframe::egui::{Color32, Stroke, Ui};
use glam::DVec3;
use ibgs_core::camera_path::turntable::Axis;
use ibgs_core::camera_path::{Keyframe, KeyframePath};

/// Seconds from one keyframe to the next, when they are set.
const APART: f64 = 2.0;
/// Seconds of a whole turn.
const TURN: f64 = 12.0;
/// Lines that the path is drawn with between two keyframes.
const PIECES: usize = 16;

/// The path in work.
pub struct PathEditor {
    /// What is edited.
    pub path: KeyframePath,
    /// Where the preview stands, in seconds.
    pub at: f64,
    pub playing: bool,
    /// The preview has moved: the camera follows.
    pub moved: bool,
    /// The whole duration was set by the user: new keyframes do not change it.
    pub timed: bool,
    /// Where it is saved and loaded.
    pub file: String,
    /// Frames of the film that are done, and their number.
    pub filming: Option<(usize, usize)>,
}

impl Default for PathEditor {
    fn default() -> Self {
        let path =
            KeyframePath { keyframes: Vec::new(), width: 1280, height: 720, fps: 30.0, seconds: APART, cycle: false };
        let file = "camera_path.json".to_owned();
        Self { path, at: 0.0, playing: false, moved: false, timed: false, file, filming: None }
    }
}

impl PathEditor {
    /// Number of keyframes.
    pub fn keyframes(&self) -> usize {
        self.path.keyframes.len()
    }

    /// Where it is saved and loaded.
    pub fn set_file(&mut self, path: &std::path::Path) {
        self.file = path.display().to_string();
    }

    /// Sets the whole duration by the keyframes, where the user has not.
    pub fn retime(&mut self) {
        if !self.timed {
            let gaps = (self.keyframes() + usize::from(self.path.cycle)).saturating_sub(1);
            self.path.seconds = APART * gaps.max(1) as f64;
        }
        self.at = self.at.min(self.path.seconds);
    }

    /// Adds a keyframe where the camera is.
    pub fn add(&mut self, navigator: &Navigator) {
        self.path.keyframes.push(navigator.keyframe());
        self.retime();
        self.at = self.path.seconds;
    }

    /// Makes the path a turn around what the camera orbits, from where it is, on the sides that the views show.
    pub fn turn(&mut self, navigator: &Navigator, views: &[View]) {
        let axis = Axis { center: navigator.pivot(), up: navigator.up };
        self.path.keyframes = axis.turn(&navigator.keyframe(), views.iter().map(|view| &view.camera));
        (self.path.cycle, self.path.seconds) = (true, TURN);
        (self.timed, self.at, self.playing) = (true, 0.0, false);
    }

    /// Plays or stops.
    pub fn toggle(&mut self) {
        self.playing = !self.playing && self.keyframes() > 1;
        if self.playing && self.at >= self.path.seconds {
            self.at = 0.0;
        }
    }

    /// Where the preview puts the camera; none where it has not moved.
    pub fn pose(&mut self, ui: &Ui) -> Option<Keyframe> {
        if self.playing {
            self.at += f64::from(ui.input(|input| input.stable_dt).min(0.25));
            if self.at >= self.path.seconds {
                match self.path.cycle {
                    true => self.at %= self.path.seconds,
                    false => (self.at, self.playing) = (self.path.seconds, false),
                }
            }
            self.moved = true;
            ui.ctx().request_repaint();
        }
        if !std::mem::take(&mut self.moved) {
            return None;
        }
        self.path.at(self.at)
    }

    /// Draws the path by lines in world space.
    pub fn draw(&self, line: impl Fn([DVec3; 2], Stroke)) {
        let count = PIECES * self.keyframes();
        let places: Vec<DVec3> = (0..=count)
            .filter_map(|i| Some(self.path.at(self.path.seconds * i as f64 / count.max(1) as f64)?.position))
            .collect();
        for ends in places.windows(2) {
            line([ends[0], ends[1]], Stroke::new(2.0, Color32::from_rgb(255, 90, 200)));
        }
    }
}
