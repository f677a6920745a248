//! What the user has chosen for every model, kept from one start of the program to the next.

use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Range of the view angle in degrees, and of the factor of the flight's speed.
pub const ANGLES: [f64; 2] = [10.0, 120.0];
pub const SPEEDS: [f64; 2] = [0.1, 10.0];
/// A new view angle of one's own in degrees.
const USUAL_ANGLE: f64 = 50.0;

/// What is behind the Gaussians.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Backdrop {
    /// The model's own background.
    #[default]
    Model,
    Black,
    White,
    /// [`Settings::color`].
    Color,
}

impl Backdrop {
    /// All of them, with their names.
    pub const ALL: [(Self, &str); 4] =
        [(Self::Model, "of the model"), (Self::Black, "black"), (Self::White, "white"), (Self::Color, "a colour")];
}

/// The unit of lengths in the editor. With one, a unit of the saved file is a metre.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Unit {
    /// That of the file, whatever it is.
    #[default]
    File,
    Metre,
    Centimetre,
    Millimetre,
    Foot,
    Inch,
}

impl Unit {
    /// All of them.
    pub const ALL: [Self; 6] = [Self::File, Self::Metre, Self::Centimetre, Self::Millimetre, Self::Foot, Self::Inch];

    /// Its name, its sign after a number, and how many of it are a unit of the file.
    fn row(self) -> (&'static str, &'static str, f64) {
        match self {
            Self::File => ("units of the file", "", 1.0),
            Self::Metre => ("metres", " m", 1.0),
            Self::Centimetre => ("centimetres", " cm", 1e2),
            Self::Millimetre => ("millimetres", " mm", 1e3),
            Self::Foot => ("feet", " ft", 1.0 / 0.3048),
            Self::Inch => ("inches", " in", 1.0 / 0.0254),
        }
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        self.row().0
    }

    /// What stands behind a number of it.
    pub fn sign(self) -> &'static str {
        self.row().1
    }

    /// How many of it are a unit of the file.
    pub fn per_file_unit(self) -> f64 {
        self.row().2
    }
}

/// All that is kept.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Settings {
    /// What was opened last, newest first.
    pub recent: Vec<PathBuf>,
    pub backdrop: Backdrop,
    /// Red, green, blue of [`Backdrop::Color`].
    pub color: [u8; 3],
    /// The camera has the view angle below once it leaves a view, not that of the view.
    pub own_angle: bool,
    /// Vertical, in degrees.
    pub angle: f64,
    /// Factor of the flight's speed.
    pub speed: f64,
    /// A grid on the ground.
    pub shows_ground: bool,
    /// A resting camera's image has the full size, however long it takes.
    pub always_sharp: bool,
    pub unit: Unit,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            recent: Vec::new(),
            backdrop: Backdrop::Model,
            color: [128; 3],
            own_angle: false,
            angle: USUAL_ANGLE,
            speed: 1.0,
            shows_ground: false,
            always_sharp: false,
            unit: Unit::File,
        }
    }
}

impl Settings {
    /// The same with what makes no sense at its default: the file that keeps it can be edited by hand.
    pub fn sound(mut self) -> Self {
        let usual = Self::default();
        let is_within = |value: f64, [low, high]: [f64; 2]| (low..=high).contains(&value);
        if !is_within(self.angle, ANGLES) {
            self.angle = usual.angle;
        }
        if !is_within(self.speed, SPEEDS) {
            self.speed = usual.speed;
        }
        self
    }

    /// The colour behind the Gaussians, red, green, blue; none: that of the model.
    pub fn background(&self) -> Option<[f32; 3]> {
        match self.backdrop {
            Backdrop::Model => None,
            Backdrop::Black => Some([0.0; 3]),
            Backdrop::White => Some([1.0; 3]),
            Backdrop::Color => Some(self.color.map(|value| f32::from(value) / 255.0)),
        }
    }

    /// The view angle of a camera that stands on no view, in radians; none: that of the view before.
    pub fn view_angle(&self) -> Option<f64> {
        self.own_angle.then(|| self.angle.to_radians())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_that_make_no_sense_are_not_taken() {
        let kept = Settings { angle: 30.0, speed: 2.0, own_angle: true, ..Settings::default() };
        assert_eq!(kept.clone().sound(), kept);
        for wrong in [f64::NAN, f64::INFINITY, -1.0, 0.0, 1e9] {
            let sound = Settings { angle: wrong, speed: wrong, ..kept.clone() }.sound();
            assert_eq!((sound.angle, sound.speed), (USUAL_ANGLE, 1.0));
        }
    }

    #[test]
    fn colours_and_lengths_are_what_they_say() {
        let with = |backdrop| Settings { backdrop, color: [255, 0, 51], ..Settings::default() }.background();
        let all = Backdrop::ALL.map(|(backdrop, _)| with(backdrop));
        assert_eq!(all, [None, Some([0.0; 3]), Some([1.0; 3]), Some([1.0, 0.0, 0.2])]);
        // A foot has twelve inches, an inch 25.4 mm.
        assert!((Unit::Inch.per_file_unit() / Unit::Foot.per_file_unit() - 12.0).abs() < 1e-9);
        assert!((Unit::Millimetre.per_file_unit() / Unit::Inch.per_file_unit() - 25.4).abs() < 1e-9);
    }
}
