//! What the canvas can show.

use crate::looks::Look;
use eframe::egui::Key;
use ibgs_core::picture::MOST_VISIBLE;
use ibgs_core::present::Shown;
use ibgs_core::sources::DevicePhoto;
use serde::{Deserialize, Serialize};

/// What the canvas shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mode {
    /// The final image.
    #[default]
    Final,
    /// The base image.
    Base,
    /// What the network adds.
    Residual,
    /// Median depth.
    Depth,
    /// Normal map.
    Normal,
    /// How many photos see each point.
    Visibility,
    /// Final image minus the photo of the view that the camera stands on.
    Difference,
    /// That photo.
    Photo,
    /// The Gaussians' centres.
    Points,
    /// The Gaussians as ellipsoids.
    Ellipsoids,
    /// What masks hide of the photo.
    Hidden,
}

/// How modes are shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Style {
    /// Depths of the brightest and the darkest colour.
    pub depth_range: [f32; 2],
    /// Factor that amplifies residual and difference.
    pub gain: f32,
}

impl Default for Style {
    fn default() -> Self {
        Self { depth_range: [0.0, 1.0], gain: 1.0 }
    }
}

/// What a mode needs.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Needs {
    Nothing,
    /// A model with a residual network.
    Network,
    /// The photo of the view that the camera stands on.
    Photo,
}

/// What the device shows in a mode.
type ShownIn = for<'a> fn(&Style, Option<&'a DevicePhoto>) -> Shown<'a>;

/// The keys of the first modes.
const KEYS: [Key; 10] =
    [Key::Num1, Key::Num2, Key::Num3, Key::Num4, Key::Num5, Key::Num6, Key::Num7, Key::Num8, Key::Num9, Key::Num0];

/// All that is known of a mode.
struct Row {
    mode: Mode,
    /// In menus.
    name: &'static str,
    /// In links.
    word: &'static str,
    meaning: &'static str,
    shown: ShownIn,
    needs: Needs,
    /// The look of the Gaussians; none: their own.
    look: Option<Look>,
    has_gain: bool,
    has_range: bool,
}

/// A mode that every model has.
const fn row(mode: Mode, name: &'static str, word: &'static str, meaning: &'static str, shown: ShownIn) -> Row {
    let (needs, look, has_gain, has_range) = (Needs::Nothing, None, false, false);
    Row { mode, name, word, meaning, shown, needs, look, has_gain, has_range }
}

/// The modes in their order.
static TABLE: [Row; 11] = [
    Row {
        needs: Needs::Network,
        ..row(
            Mode::Final,
            "Final",
            "final",
            "Base colour plus the residual that the network reads from neighbouring photos",
            |_, _| Shown::Final,
        )
    },
    row(Mode::Base, "Base", "base", "Gaussian splatting alone: colours from spherical harmonics", |_, _| Shown::Base),
    Row {
        needs: Needs::Network,
        has_gain: true,
        ..row(
            Mode::Residual,
            "Residual",
            "residual",
            "Final minus base image around grey: what the network and the source photos add",
            |style, _| Shown::Residual(style.gain),
        )
    },
    Row {
        has_range: true,
        ..row(
            Mode::Depth,
            "Depth",
            "depth",
            "Depth where half of the light is stopped, near bright and far dark",
            |style, _| Shown::Depth(style.depth_range),
        )
    },
    row(
        Mode::Normal,
        "Normal",
        "normal",
        "Surface normals as the camera sees them: red right, green up, blue towards it",
        |_, _| Shown::Normal,
    ),
    Row {
        needs: Needs::Network,
        ..row(
            Mode::Visibility,
            "Visible sources",
            "visibility",
            "How many of the source photos see the point of a pixel; black: none",
            |_, _| Shown::Visibility(MOST_VISIBLE),
        )
    },
    Row {
        needs: Needs::Photo,
        has_gain: true,
        ..row(
            Mode::Difference,
            "Difference",
            "difference",
            "Final image minus the photo around grey, while the camera stands on a view",
            |style, photo| photo.map_or(Shown::Final, |photo| Shown::Difference(photo, style.gain)),
        )
    },
    Row {
        needs: Needs::Photo,
        ..row(Mode::Photo, "Photo", "photo", "The photo itself, while the camera stands on a view", |_, photo| {
            photo.map_or(Shown::Final, Shown::Photo)
        })
    },
    Row {
        look: Some(Look::Points),
        ..row(Mode::Points, "Points", "points", "The centres of the Gaussians, opaque and in their colours", |_, _| {
            Shown::Base
        })
    },
    Row {
        look: Some(Look::Ellipsoids),
        ..row(
            Mode::Ellipsoids,
            "Ellipsoids",
            "ellipsoids",
            "The Gaussians as opaque ellipsoids of 1.5 standard deviations, the nearest centre in front",
            |_, _| Shown::Base,
        )
    },
    Row {
        needs: Needs::Photo,
        ..row(
            Mode::Hidden,
            "Hidden",
            "hidden",
            "What masks hide of the photo in its colours, the rest dark and grey, while the camera stands on a view",
            |_, photo| photo.map_or(Shown::Final, Shown::Hidden),
        )
    },
];

impl Mode {
    /// All of them, in the order of their keys.
    pub const ALL: [Mode; TABLE.len()] = {
        let mut all = [Mode::Final; TABLE.len()];
        let mut i = 0;
        while i < TABLE.len() {
            all[i] = TABLE[i].mode;
            assert!(all[i] as usize == i, "the table has the order of the enum");
            i += 1;
        }
        all
    };

    fn row(self) -> &'static Row {
        &TABLE[self as usize]
    }

    /// The key that shows it; the first ten have one.
    pub fn key(self) -> Option<Key> {
        KEYS.get(self as usize).copied()
    }

    /// Its name in menus.
    pub fn name(self) -> &'static str {
        self.row().name
    }

    /// Its word in links.
    pub fn word(self) -> &'static str {
        self.row().word
    }

    /// What it means.
    pub fn meaning(self) -> &'static str {
        self.row().meaning
    }

    /// Whether only a model with a residual network has it.
    pub fn needs_network(self) -> bool {
        self.row().needs == Needs::Network
    }

    /// Whether only a view with a photo has it.
    pub fn needs_photo(self) -> bool {
        self.row().needs == Needs::Photo
    }

    /// Whether its strength can be chosen.
    pub fn has_gain(self) -> bool {
        self.row().has_gain
    }

    /// Whether its colours stand for depths in a range, which has to be found and is said.
    pub fn has_range(self) -> bool {
        self.row().has_range
    }

    /// Whether it shows the Gaussians in their own colours. In the final image the residual takes a tint away again.
    pub fn has_colors(self) -> bool {
        matches!(self, Mode::Base | Mode::Points | Mode::Ellipsoids)
    }

    /// The look of the Gaussians that it shows; none: their own.
    pub fn look(self) -> Option<Look> {
        self.row().look
    }

    /// The same for the device; the final image where a photo is needed and there is none.
    pub fn shown<'a>(self, style: &Style, photo: Option<&'a DevicePhoto>) -> Shown<'a> {
        (self.row().shown)(style, photo)
    }
}
