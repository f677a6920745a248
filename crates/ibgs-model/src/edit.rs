//! Selecting, hiding, locking and removing Gaussians of a finished model: which ones ([`Mask`]), by what ([`CropBox`], [`Ball`],
//! [`Screen`], [`Flood`], [`Floaters`], [`Value`]), the steps that were taken ([`Editor`]), and what they leave of each base of an
//! ensemble ([`Bases`]). Knows neither windows nor devices.

mod bases;
mod choose;
mod groups;
mod mask;
mod placing;
mod screen;
#[cfg(test)]
mod tests;
mod values;

pub use bases::Bases;
pub use choose::{Ball, CropBox, box_edges};
pub use groups::{Floaters, Flood, color, of_color};
pub use mask::Mask;
pub use placing::{UP, scaled, upright};
pub use screen::{Screen, nearest};
pub use values::{Histogram, Value, in_range};

use crate::scene::Gaussians;
use crate::similarity::Similarity;
use glam::DVec3;
use std::sync::Arc;

/// Most memory of the steps that can be undone; at least [`LEAST_STEPS`] are kept.
const MOST_BYTES: usize = 64 << 20;
const LEAST_STEPS: usize = 8;
const MOST_STEPS: usize = 256;

/// How a new selection combines with the one before.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Combine {
    /// The new one alone.
    #[default]
    Replace,
    /// Both.
    Add,
    /// The one before without the new one.
    Remove,
    /// What is in both.
    Intersect,
}

/// Where the centre of a Gaussian lies in the scene.
fn place(gaussians: &Gaussians, index: usize) -> DVec3 {
    gaussians.space.to_scene(DVec3::from(gaussians.means[index].map(f64::from)))
}

/// Which Gaussians of a model are left, and which of them are selected, hidden and locked. Steps share what they do not change.
#[derive(Clone, Debug, PartialEq)]
struct EditState {
    left: Arc<Mask>,
    selected: Arc<Mask>,
    hidden: Arc<Mask>,
    locked: Arc<Mask>,
    placement: Similarity,
}

/// The selection on a model, what was hidden, locked and removed, and the steps to here.
#[derive(Clone, Debug)]
pub struct Editor {
    gaussians: Arc<Gaussians>,
    now: EditState,
    /// What is left and not hidden.
    shown: Arc<Mask>,
    undo: Vec<EditState>,
    redo: Vec<EditState>,
    /// Numbers that the panel shows, counted once a step: left, selected, hidden, locked.
    counts: [usize; 4],
}

impl Editor {
    /// Nothing is selected, nothing removed.
    pub fn new(gaussians: Arc<Gaussians>) -> Self {
        let count = gaussians.len();
        let (all, none) = (Arc::new(Mask::all(count)), Arc::new(Mask::none(count)));
        let now = EditState {
            left: all.clone(),
            selected: none.clone(),
            hidden: none.clone(),
            locked: none,
            placement: Similarity::IDENTITY,
        };
        Self { gaussians, now, shown: all, undo: Vec::new(), redo: Vec::new(), counts: [count, 0, 0, 0] }
    }

    /// The whole model, with what was removed.
    pub fn gaussians(&self) -> &Arc<Gaussians> {
        &self.gaussians
    }

    /// What is left of it.
    pub fn left(&self) -> &Arc<Mask> {
        &self.now.left
    }

    /// What is left and not hidden.
    pub fn shown(&self) -> &Arc<Mask> {
        &self.shown
    }

    /// The Gaussians among those that are selected.
    pub fn selected(&self) -> &Arc<Mask> {
        &self.now.selected
    }

    /// What can be selected: what is shown and not locked.
    pub fn selectable(&self) -> Mask {
        self.shown.without(&self.now.locked)
    }

    /// Gaussians that are left.
    pub fn left_count(&self) -> usize {
        self.counts[0]
    }

    /// Gaussians that are selected.
    pub fn selected_count(&self) -> usize {
        self.counts[1]
    }

    /// Gaussians that are hidden.
    pub fn hidden_count(&self) -> usize {
        self.counts[2]
    }

    /// Gaussians that are locked.
    pub fn locked_count(&self) -> usize {
        self.counts[3]
    }

    /// Where the model stands: what takes its coordinates to those that it is saved in.
    pub fn placement(&self) -> &Similarity {
        &self.now.placement
    }

    /// Places the model within a step, as a value does while it is dragged. Scales that are not positive, and numbers that are
    /// none, change nothing.
    pub fn change_placement(&mut self, placement: Similarity) {
        let Similarity { scale, rotation, translation } = placement;
        if scale > 0.0 && scale.is_finite() && rotation.is_finite() && translation.is_finite() {
            self.set(EditState { placement, ..self.now.clone() });
        }
    }

    /// Places the model in one step.
    pub fn place(&mut self, placement: Similarity) {
        self.begin();
        self.change_placement(placement);
        self.end();
    }

    /// Whether some are selected and some are not: a model keeps at least one Gaussian.
    pub fn can_remove(&self) -> bool {
        (1..self.left_count()).contains(&self.selected_count())
    }

    /// Whether there is a step to undo.
    pub fn can_undo(&self) -> bool {
        !self.undo.is_empty()
    }

    /// Whether there is a step to redo.
    pub fn can_redo(&self) -> bool {
        !self.redo.is_empty()
    }

    fn set(&mut self, now: EditState) {
        self.shown = Arc::new(now.left.without(&now.hidden));
        self.counts = [&now.left, &now.selected, &now.hidden, &now.locked].map(|mask| mask.count());
        self.now = now;
    }

    /// Begins a step: [`Editor::undo`] returns to here.
    pub fn begin(&mut self) {
        self.redo.clear();
        self.undo.push(self.now.clone());
        let bytes = 4 * self.now.left.bytes().max(1);
        let most = (MOST_BYTES / bytes).clamp(LEAST_STEPS, MOST_STEPS);
        let excess = self.undo.len().saturating_sub(most);
        self.undo.drain(..excess);
    }

    /// Ends a step; a step that has changed nothing is dropped.
    pub fn end(&mut self) {
        if self.undo.last() == Some(&self.now) {
            self.undo.pop();
        }
    }

    /// A whole step.
    fn step(&mut self, now: EditState) {
        self.begin();
        self.set(now);
        self.end();
    }

    /// Changes the selection within a step, as a brush does while it moves. What was removed, is hidden or locked is never
    /// selected.
    pub fn change(&mut self, found: &Mask, how: Combine) {
        let before = &self.now.selected;
        let selected = match how {
            Combine::Replace => found.and(&self.selectable()),
            Combine::Add => before.or(&found.and(&self.selectable())),
            Combine::Remove => before.without(found),
            Combine::Intersect => before.and(found),
        };
        if selected != **before {
            self.set(EditState { selected: Arc::new(selected), ..self.now.clone() });
        }
    }

    /// Changes the selection in one step.
    pub fn select(&mut self, found: &Mask, how: Combine) {
        self.begin();
        self.change(found, how);
        self.end();
    }

    /// Selects all that can be selected.
    pub fn select_all(&mut self) {
        self.select(&self.selectable(), Combine::Replace);
    }

    /// Selects nothing.
    pub fn select_none(&mut self) {
        self.select(&self.none(), Combine::Replace);
    }

    /// Selects what can be selected and was not.
    pub fn invert(&mut self) {
        let others = self.selectable().without(&self.now.selected);
        self.select(&others, Combine::Replace);
    }

    fn none(&self) -> Mask {
        Mask::none(self.gaussians.len())
    }

    /// Hides the selected Gaussians; they stay in the model. False if none or all that are seen are selected.
    pub fn hide(&mut self) -> bool {
        let hides = self.selected_count() > 0 && self.selected_count() < self.shown.count();
        if hides {
            let hidden = Arc::new(self.now.hidden.or(&self.now.selected));
            self.step(EditState { hidden, selected: Arc::new(self.none()), ..self.now.clone() });
        }
        hides
    }

    /// Shows what is hidden. False if nothing is.
    pub fn show_all(&mut self) -> bool {
        let shows = self.hidden_count() > 0;
        if shows {
            self.step(EditState { hidden: Arc::new(self.none()), ..self.now.clone() });
        }
        shows
    }

    /// Locks the selected Gaussians: they are seen, but no tool selects or removes them. False if none are selected.
    pub fn lock(&mut self) -> bool {
        let locks = self.selected_count() > 0;
        if locks {
            let locked = Arc::new(self.now.locked.or(&self.now.selected));
            self.step(EditState { locked, selected: Arc::new(self.none()), ..self.now.clone() });
        }
        locks
    }

    /// Unlocks what is locked. False if nothing is.
    pub fn unlock_all(&mut self) -> bool {
        let unlocks = self.locked_count() > 0;
        if unlocks {
            self.step(EditState { locked: Arc::new(self.none()), ..self.now.clone() });
        }
        unlocks
    }

    /// Removes the selected Gaussians. False if none or all are selected.
    pub fn delete(&mut self) -> bool {
        self.remove(&self.now.selected.clone())
    }

    /// Removes what is not selected; what is hidden or locked stays. False if none or all are selected.
    pub fn keep(&mut self) -> bool {
        self.selected_count() > 0 && self.crop(&self.now.selected.clone())
    }

    /// Removes what is not in a mask; what is hidden or locked stays. False if that is nothing or all.
    pub fn crop(&mut self, found: &Mask) -> bool {
        self.remove(&self.selectable().without(found))
    }

    fn remove(&mut self, removed: &Mask) -> bool {
        let left = self.now.left.without(removed);
        let removes = (1..self.left_count()).contains(&left.count());
        if removes {
            let rest = |mask: &Mask| Arc::new(mask.and(&left));
            let (hidden, locked) = (rest(&self.now.hidden), rest(&self.now.locked));
            self.step(EditState {
                selected: Arc::new(self.none()),
                hidden,
                locked,
                left: Arc::new(left),
                ..self.now.clone()
            });
        }
        removes
    }

    /// Undoes the last step.
    pub fn undo(&mut self) {
        if let Some(state) = self.undo.pop() {
            self.redo.push(self.now.clone());
            self.set(state);
        }
    }

    /// Redoes the step that was undone last.
    pub fn redo(&mut self) {
        if let Some(state) = self.redo.pop() {
            self.undo.push(self.now.clone());
            self.set(state);
        }
    }
}
