//! What the canvas can show.

use crate::looks::Look;
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
}

/// How modes are shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Style {
    /// Depths of the brightest and the darkest colour.
    pub depth_range: [f32; 2],
    /// Factor that amplifies residual and difference.
    pub gain: f32,
    /// Number of sources that has the brightest colour.
    pub most_sources: u32,
}

impl Default for Style {
    fn default() -> Self {
        Self { depth_range: [0.0, 1.0], gain: 1.0, most_sources: 1 }
    }
}

impl Mode {
    /// All of them; the number keys from 1 on.
    pub const ALL: [Mode; 10] = [
        Mode::Final,
        Mode::Base,
        Mode::Residual,
        Mode::Depth,
        Mode::Normal,
        Mode::Visibility,
        Mode::Difference,
        Mode::Photo,
        Mode::Points,
        Mode::Ellipsoids,
    ];

    /// Its name in menus.
    pub fn name(self) -> &'static str {
        match self {
            Mode::Final => "Final",
            Mode::Base => "Base",
            Mode::Residual => "Residual",
            Mode::Depth => "Depth",
            Mode::Normal => "Normal",
            Mode::Visibility => "Visible sources",
            Mode::Difference => "Difference",
            Mode::Photo => "Photo",
            Mode::Points => "Points",
            Mode::Ellipsoids => "Ellipsoids",
        }
    }

    /// Its word in links.
    pub fn word(self) -> &'static str {
        match self {
            Mode::Final => "final",
            Mode::Base => "base",
            Mode::Residual => "residual",
            Mode::Depth => "depth",
            Mode::Normal => "normal",
            Mode::Visibility => "visibility",
            Mode::Difference => "difference",
            Mode::Photo => "photo",
            Mode::Points => "points",
            Mode::Ellipsoids => "ellipsoids",
        }
    }

    /// What it means.
    pub fn meaning(self) -> &'static str {
        match self {
            Mode::Final => "Base colour plus the residual that the network reads from neighbouring photos",
            Mode::Base => "Gaussian splatting alone: colours from spherical harmonics",
            Mode::Residual => "Final minus base image around grey: what the network and the source photos add",
            Mode::Depth => "Depth where half of the light is stopped, near bright and far dark",
            Mode::Normal => "Surface normals as the camera sees them: red right, green up, blue towards it",
            Mode::Visibility => "How many of the source photos see the point of a pixel; black: none",
            Mode::Difference => "Final image minus the photo around grey, while the camera stands on a view",
            Mode::Photo => "The photo itself, while the camera stands on a view",
            Mode::Points => "The centres of the Gaussians, opaque and in their colours",
            Mode::Ellipsoids => {
                "The Gaussians as opaque ellipsoids of 1.5 standard deviations, the nearest centre in front"
            }
        }
    }

    /// Whether only a model with a residual network has it.
    pub fn needs_network(self) -> bool {
        matches!(self, Mode::Residual | Mode::Visibility)
    }

    /// Whether only a view with a photo has it.
    pub fn needs_photo(self) -> bool {
        matches!(self, Mode::Difference | Mode::Photo)
    }

    /// Whether its strength can be chosen.
    pub fn has_gain(self) -> bool {
        matches!(self, Mode::Residual | Mode::Difference)
    }

    /// The look of the Gaussians that it shows; none: their own.
    pub fn look(self) -> Option<Look> {
        match self {
            Mode::Points => Some(Look::Points),
            Mode::Ellipsoids => Some(Look::Ellipsoids),
            _ => None,
        }
    }

    /// The same for the device; the final image where a photo is needed and there is none.
    pub fn shown<'a>(self, style: &Style, photo: Option<&'a DevicePhoto>) -> Shown<'a> {
        match (self, photo) {
            (Mode::Final, _) | (Mode::Difference | Mode::Photo, None) => Shown::Final,
            (Mode::Base | Mode::Points | Mode::Ellipsoids, _) => Shown::Base,
            (Mode::Residual, _) => Shown::Residual(style.gain),
            (Mode::Depth, _) => Shown::Depth(style.depth_range),
            (Mode::Normal, _) => Shown::Normal,
            (Mode::Visibility, _) => Shown::Visibility(style.most_sources),
            (Mode::Difference, Some(photo)) => Shown::Difference(photo, style.gain),
            (Mode::Photo, Some(photo)) => Shown::Photo(photo),
        }
    }
}
