//! The numbers that decide what is hidden.

/// What decides over masks. A training has the default ones; others are for measuring.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MaskRules {
    /// Part of the evidence that a visit of a photo replaces.
    pub rate: f32,
    /// The distance from the render that this part of all cells does not exceed is the scale: what is usual.
    pub usual: f64,
    /// Times the scale where no other photo says anything about a cell.
    pub alone: f32,
    /// Part of the distance between the render and the warped photos below which nothing is evidence: where they disagree, as on a
    /// mirror, the place is hard to render, whatever moves.
    pub between: f32,
    /// Evidence, in units of the scale, from which a cell is surely of something that moves.
    pub sure: f32,
    /// The same where it was hidden before.
    pub sure_again: f32,
    /// Evidence from which a cell belongs to one beside it that is.
    pub likely: f32,
    /// Least of what counts as likely, in parts of white: less than that is hardly seen.
    pub least: f32,
    /// Sure cells that something has, at least.
    pub fewest: usize,
    /// Largest part of a photo that is hidden: beyond it the photo is bad as a whole.
    pub limit: f32,
    /// `auto` hides something where that is at least this part of all photos' cells.
    pub worth: f64,
    /// Weight of the loss of a photo that disagrees as a whole.
    pub odd_weight: f32,
    /// A photo is blurred if it has less than this part of the usual detail, as a part of its render's.
    pub blurred: f32,
    /// It has another brightness if its difference from the render has a median over this, in parts of white, and over `times` the
    /// usual one.
    pub brightness: f32,
    /// It shows something else if its median error is so many times the usual one.
    pub times: f32,
}

impl Default for MaskRules {
    fn default() -> Self {
        Self {
            rate: 0.3,
            usual: 0.9,
            alone: 3.0,
            between: 1.0,
            sure: 4.0,
            sure_again: 3.0,
            likely: 2.0,
            least: 0.02,
            fewest: 3,
            limit: 0.4,
            worth: 0.015,
            odd_weight: 0.3,
            blurred: 0.7,
            brightness: 0.04,
            times: 3.0,
        }
    }
}
