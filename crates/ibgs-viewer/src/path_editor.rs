//! The camera path in work, and its preview.

use crate::View;
use crate::film::FilmQuality;
use crate::mode::Mode;
use crate::navigator::Navigator;
use crate::preparing::Bar;
use eframe::egui::{Color32, Stroke, TextureHandle, Ui};
use glam::DVec3;
use ibgs_core::camera_path::turntable::Axis;
use ibgs_core::camera_path::{Keyframe, KeyframePath};

/// Seconds of the way to a new keyframe.
const APART: f64 = 2.0;
/// Seconds of a whole turn.
const TURN: f64 = 12.0;
/// Lines that the path is drawn with between two keyframes, and in all.
const PIECES: usize = 16;
const MOST_PIECES: usize = 4_000;

/// The picture of a keyframe.
#[derive(Clone, Default)]
pub enum Picture {
    /// It is still to be asked for.
    #[default]
    Wanted,
    /// It is asked for.
    Asked,
    /// It cannot be rendered.
    Failed,
    There(TextureHandle),
}

/// The path in work.
pub struct PathEditor {
    /// What is edited.
    pub path: KeyframePath,
    /// What the keyframes show.
    pub pictures: Vec<Picture>,
    /// The keyframe that is dragged along the timeline.
    pub dragged: Option<usize>,
    /// Where the preview stands, in seconds.
    pub at: f64,
    pub playing: bool,
    /// The preview has moved: the camera follows.
    pub moved: bool,
    /// Where it is saved and loaded.
    pub file: String,
    /// What the film shows; none: what the window shows.
    pub mode: Option<Mode>,
    pub quality: FilmQuality,
    /// The film in work.
    pub filming: Option<Bar>,
    /// What was written last.
    pub written: Option<String>,
}

impl Default for PathEditor {
    fn default() -> Self {
        let (width, height, fps, seconds) = (1280, 720, 30.0, APART);
        let path = KeyframePath { keyframes: Vec::new(), width, height, fps, seconds, cycle: false, eased: false };
        Self {
            path,
            pictures: Vec::new(),
            dragged: None,
            at: 0.0,
            playing: false,
            moved: false,
            file: "camera_path.json".to_owned(),
            mode: None,
            quality: FilmQuality::default(),
            filming: None,
            written: None,
        }
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

    /// Takes another path.
    pub fn load(&mut self, path: KeyframePath) {
        (self.path, self.at, self.moved, self.playing) = (path, 0.0, true, false);
        (self.pictures, self.dragged) = (vec![Picture::Wanted; self.keyframes()], None);
    }

    /// Forgets the keyframes.
    pub fn clear(&mut self) {
        self.path.keyframes.clear();
        self.path.seconds = APART;
        (self.pictures, self.dragged, self.at, self.playing) = (Vec::new(), None, 0.0, false);
    }

    /// Adds a keyframe where the camera is.
    pub fn add(&mut self, navigator: &Navigator) {
        let key = Keyframe { way: APART, ..navigator.keyframe() };
        self.path.change(|path| path.keyframes.push(key));
        self.pictures.push(Picture::Wanted);
        self.at = self.path.time_of(self.keyframes() - 1);
    }

    /// Moves a keyframe to where the camera is.
    pub fn set(&mut self, index: usize, navigator: &Navigator) {
        let key = &mut self.path.keyframes[index];
        *key = Keyframe { way: key.way, ..navigator.keyframe() };
        self.pictures[index] = Picture::Wanted;
    }

    /// Removes a keyframe.
    pub fn remove(&mut self, index: usize) {
        self.path.change(|path| _ = path.keyframes.remove(index));
        self.pictures.remove(index);
        self.dragged = None;
        self.playing &= self.keyframes() > 1;
    }

    /// Moves a keyframe to another place in the order.
    pub fn reorder(&mut self, from: usize, to: usize) {
        self.path.change(|path| {
            let key = path.keyframes.remove(from);
            path.keyframes.insert(to, key);
        });
        let picture = self.pictures.remove(from);
        self.pictures.insert(to, picture);
        self.go_to(to);
    }

    /// Lets the way to a keyframe take so many seconds.
    pub fn set_way(&mut self, index: usize, seconds: f64) {
        self.path.change(|path| path.keyframes[index].way = seconds);
    }

    /// The next keyframe whose picture is to be asked for, one after the other.
    pub fn lacks_picture(&mut self) -> Option<Keyframe> {
        if self.pictures.iter().any(|picture| matches!(picture, Picture::Asked)) {
            return None;
        }
        let index = self.pictures.iter().position(|picture| matches!(picture, Picture::Wanted))?;
        self.pictures[index] = Picture::Asked;
        Some(self.path.keyframes[index])
    }

    /// Takes what a keyframe shows, wherever it stands by now.
    pub fn take_picture(&mut self, of: &Keyframe, picture: &Picture) {
        let stands_there = |key: &Keyframe| Keyframe { way: of.way, ..*key } == *of;
        for (key, awaited) in self.path.keyframes.iter().zip(&mut self.pictures) {
            if matches!(awaited, Picture::Asked) && stands_there(key) {
                *awaited = picture.clone();
            }
        }
    }

    /// Whether pictures of keyframes are still to come.
    pub fn awaits_pictures(&self) -> bool {
        self.pictures.iter().any(|picture| matches!(picture, Picture::Wanted | Picture::Asked))
    }

    /// Closes the path, or opens it.
    pub fn set_cycle(&mut self, cycle: bool) {
        self.path.change(|path| path.cycle = cycle);
    }

    /// Stands at a keyframe.
    pub fn go_to(&mut self, index: usize) {
        (self.at, self.moved, self.playing) = (self.path.time_of(index), true, false);
    }

    /// The keyframe that the preview stands at, of those that are passed at these times.
    pub fn current(&self, times: &[f64]) -> Option<usize> {
        times.iter().take(self.keyframes()).position(|time| (time - self.at).abs() < 1e-6)
    }

    /// Makes the path a turn around what the camera orbits, from where it is, on the sides that the views show.
    pub fn turn(&mut self, navigator: &Navigator, views: &[View]) {
        let axis = Axis { center: navigator.pivot(), up: navigator.up };
        let keyframes = axis.turn(&navigator.keyframe(), views.iter().map(|view| &view.camera));
        self.load(KeyframePath { keyframes, cycle: true, seconds: TURN, ..self.path.clone() });
        self.moved = false;
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
        let count = (PIECES * self.keyframes()).min(MOST_PIECES) + 1;
        let places: Vec<DVec3> = self.path.along(count).map(|key| key.position).collect();
        for ends in places.windows(2) {
            line([ends[0], ends[1]], Stroke::new(2.0, Color32::from_rgb(255, 90, 200)));
        }
    }
}
