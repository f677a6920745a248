//! Selecting and removing Gaussians of a finished model: which ones ([`Mask`]), by what ([`CropBox`], [`Brush`], [`Filter`]), the
//! steps that were taken ([`Editor`]), and what they leave of each base of an ensemble ([`Bases`]). Knows neither windows nor
//! devices.

mod bases;
mod choose;
mod mask;

pub use bases::Bases;
pub use choose::{Brush, CropBox, Filter, box_edges};
pub use mask::Mask;

use crate::scene::Gaussians;
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
}

/// Which Gaussians of a model are left, and which are selected. Steps that change only one of the two share the other.
#[derive(Clone, Debug, PartialEq)]
struct EditState {
    left: Arc<Mask>,
    selected: Arc<Mask>,
}

/// The selection on a model, what was removed of it, and the steps to here.
#[derive(Clone, Debug)]
pub struct Editor {
    gaussians: Arc<Gaussians>,
    now: EditState,
    undo: Vec<EditState>,
    redo: Vec<EditState>,
    /// Numbers that the panel shows, counted once a step.
    counts: [usize; 2],
}

impl Editor {
    /// Nothing is selected, nothing removed.
    pub fn new(gaussians: Arc<Gaussians>) -> Self {
        let count = gaussians.len();
        let now = EditState { left: Arc::new(Mask::all(count)), selected: Arc::new(Mask::none(count)) };
        Self { gaussians, now, undo: Vec::new(), redo: Vec::new(), counts: [count, 0] }
    }

    /// The whole model, with what was removed.
    pub fn gaussians(&self) -> &Arc<Gaussians> {
        &self.gaussians
    }

    /// What is left of it.
    pub fn left(&self) -> &Arc<Mask> {
        &self.now.left
    }

    /// The Gaussians among those that are selected.
    pub fn selected(&self) -> &Mask {
        &self.now.selected
    }

    /// Gaussians that are left.
    pub fn left_count(&self) -> usize {
        self.counts[0]
    }

    /// Gaussians that are selected.
    pub fn selected_count(&self) -> usize {
        self.counts[1]
    }

    /// Whether something was removed.
    pub fn is_changed(&self) -> bool {
        self.left_count() < self.gaussians.len()
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
        self.counts = [now.left.count(), now.selected.count()];
        self.now = now;
    }

    /// Begins a step: [`Editor::undo`] returns to here.
    pub fn begin(&mut self) {
        self.redo.clear();
        self.undo.push(self.now.clone());
        let bytes = 2 * self.now.left.bytes().max(1);
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

    /// Changes the selection within a step, as a brush does while it moves. What was removed is never selected.
    pub fn change(&mut self, found: &Mask, how: Combine) {
        let (left, before) = (&self.now.left, &self.now.selected);
        let selected = match how {
            Combine::Replace => found.and(left),
            Combine::Add => before.or(&found.and(left)),
            Combine::Remove => before.without(found),
        };
        if selected != **before {
            self.set(EditState { left: left.clone(), selected: Arc::new(selected) });
        }
    }

    /// Changes the selection in one step.
    pub fn select(&mut self, found: &Mask, how: Combine) {
        self.begin();
        self.change(found, how);
        self.end();
    }

    /// Selects all that is left.
    pub fn select_all(&mut self) {
        let left = self.now.left.clone();
        self.select(&left, Combine::Replace);
    }

    /// Selects nothing.
    pub fn select_none(&mut self) {
        self.select(&Mask::none(self.gaussians.len()), Combine::Replace);
    }

    /// Selects what is left and was not selected.
    pub fn invert(&mut self) {
        let others = self.now.left.without(&self.now.selected);
        self.select(&others, Combine::Replace);
    }

    /// Removes the selected Gaussians. False if none or all are selected.
    pub fn delete(&mut self) -> bool {
        self.leave(self.now.left.without(&self.now.selected))
    }

    /// Removes the Gaussians that are not selected. False if none or all are selected.
    pub fn keep(&mut self) -> bool {
        self.leave(Mask::clone(&self.now.selected))
    }

    fn leave(&mut self, left: Mask) -> bool {
        if !self.can_remove() {
            return false;
        }
        self.begin();
        self.set(EditState { selected: Arc::new(Mask::none(left.total())), left: Arc::new(left) });
        true
    }

    /// Undoes the last step; true if that changes which Gaussians are left.
    pub fn undo(&mut self) -> bool {
        let Some(state) = self.undo.pop() else { return false };
        self.redo.push(self.now.clone());
        self.replace(state)
    }

    /// Redoes the step that was undone last; true if that changes which Gaussians are left.
    pub fn redo(&mut self) -> bool {
        let Some(state) = self.redo.pop() else { return false };
        self.undo.push(self.now.clone());
        self.replace(state)
    }

    fn replace(&mut self, state: EditState) -> bool {
        let changes = state.left != self.now.left;
        self.set(state);
        changes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A row of Gaussians along x that differ in every field.
    fn row(count: usize) -> Arc<Gaussians> {
        let at = |i: usize| i as f32;
        let values = |of: fn(f32) -> f32| (0..count).map(move |i| of(at(i)));
        Arc::new(Gaussians {
            means: values(|x| x).map(|x| [x, 0.0, 0.0]).collect(),
            rotations: values(|x| x + 1.0).map(|w| [w, 0.0, 0.0, 0.5]).collect(),
            log_scales: values(|x| -x).map(|s| [s, s - 1.0, s - 2.0]).collect(),
            opacity_logits: values(|x| x - 3.0).collect(),
            sh: values(|x| x).flat_map(|x| (0..12).map(move |c| x * 100.0 + c as f32)).collect(),
            sh_degree: 1,
            normals: values(|x| x).map(|x| [0.0, x, 1.0]).collect(),
            offsets: values(|x| x * 0.5).collect(),
            ..Gaussians::default()
        })
    }

    fn of(count: usize, chosen: &[usize]) -> Mask {
        Mask::of(count, |i| chosen.contains(&i))
    }

    fn list(mask: &Mask) -> Vec<usize> {
        mask.iter().collect()
    }

    #[test]
    fn every_field_of_the_kept_gaussians_stays_as_it_is() {
        let whole = row(70);
        let kept = of(70, &[0, 3, 64, 69]).of_model(&whole);
        kept.validate().unwrap();
        assert_eq!(kept.len(), 4);
        for (now, before) in [(0, 0), (1, 3), (2, 64), (3, 69)] {
            assert_eq!(kept.row(now), whole.row(before));
        }
        assert_eq!(Mask::all(70).of_model(&whole), *whole);
    }

    #[test]
    fn selections_combine_and_forget_what_was_removed() {
        let mut editor = Editor::new(row(6));
        editor.select(&of(6, &[0, 1, 2]), Combine::Replace);
        editor.select(&of(6, &[2, 3]), Combine::Add);
        assert_eq!(list(editor.selected()), [0, 1, 2, 3]);
        editor.select(&of(6, &[1, 5]), Combine::Remove);
        assert_eq!((list(editor.selected()), editor.selected_count()), (vec![0, 2, 3], 3));
        editor.invert();
        assert_eq!(list(editor.selected()), [1, 4, 5]);
        assert!(editor.delete());
        assert_eq!((list(editor.left()), editor.left_count(), editor.selected_count()), (vec![0, 2, 3], 3, 0));
        editor.select(&of(6, &[0, 1]), Combine::Replace);
        assert_eq!(list(editor.selected()), [0], "1 was removed");
        editor.select_all();
        assert_eq!(list(editor.selected()), [0, 2, 3]);
        assert!(!editor.delete() && !editor.keep(), "one Gaussian stays, and keeping all is no change");
        editor.select_none();
        assert!(!editor.delete() && !editor.keep());
        editor.select(&of(6, &[3]), Combine::Replace);
        assert!(editor.keep() && list(editor.left()) == [3]);
    }

    #[test]
    fn steps_are_undone_and_redone() {
        let mut editor = Editor::new(row(4));
        assert!(!editor.can_undo() && !editor.undo() && !editor.redo());
        editor.select(&of(4, &[1]), Combine::Replace);
        editor.delete();
        editor.select(&of(4, &[2]), Combine::Replace);
        assert!(!editor.undo(), "the selection alone changes");
        assert!(editor.undo(), "the deleted Gaussian is back");
        assert_eq!((list(editor.left()), list(editor.selected())), (vec![0, 1, 2, 3], vec![1]));
        assert!(editor.redo() && list(editor.left()) == [0, 2, 3] && editor.can_redo());
        editor.select(&of(4, &[3]), Combine::Replace);
        assert!(!editor.can_redo(), "a new step ends what could be redone");
        // A step without a change is dropped, so a stroke beside the model needs no undo.
        let steps = editor.undo.len();
        editor.begin();
        editor.change(&Mask::none(4), Combine::Add);
        editor.end();
        assert_eq!(editor.undo.len(), steps);
        // A stroke is one step.
        editor.begin();
        editor.change(&of(4, &[0]), Combine::Add);
        editor.change(&of(4, &[2]), Combine::Add);
        editor.end();
        assert_eq!(list(editor.selected()), [0, 2, 3]);
        editor.undo();
        assert_eq!(list(editor.selected()), [3]);
    }

    #[test]
    fn the_memory_of_steps_is_bounded() {
        let mut editor = Editor::new(row(3));
        for step in 0..1000 {
            editor.select(&of(3, &[step % 3]), Combine::Replace);
        }
        assert_eq!(editor.undo.len(), MOST_STEPS);
        while editor.can_undo() {
            editor.undo();
        }
        assert_eq!(editor.redo.len(), MOST_STEPS);
    }
}
