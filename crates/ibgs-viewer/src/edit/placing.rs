//! Placing the model: by a known length, by points of the ground, and by numbers.

use super::{Edit, Tool};
use crate::Viewer;
use glam::DVec3;
use ibgs_core::camera::Camera;
use ibgs_core::edit::{UP, scaled, upright};
use ibgs_core::similarity::Similarity;

impl Edit {
    /// A point of the surface was clicked, from this camera.
    pub(super) fn point(&mut self, point: DVec3, camera: &Camera) -> Result<(), &'static str> {
        let most = if self.tool == Some(Tool::Ground) { 3 } else { 2 };
        if self.points.len() >= most {
            self.points.clear();
        }
        self.points.push(point);
        if let (Some(Tool::Ground), &[a, b, c]) = (self.tool, &self.points[..]) {
            self.points.clear();
            let placement =
                self.editor.as_ref().and_then(|editor| upright(editor.placement(), [a, b, c], camera.center()));
            self.place(placement.ok_or("the three points are on a line; click them again")?);
        }
        self.true_length = self.length().unwrap_or(self.true_length);
        Ok(())
    }

    /// The distance of the two points that were clicked, in the units of the file.
    pub fn length(&self) -> Option<f64> {
        let &[from, to] = &self.points[..] else { return None };
        Some(self.editor.as_ref()?.placement().scale * from.distance(to))
    }

    /// Scales the model so that the measured length is what it is said to be.
    pub fn set_length(&mut self) {
        if let (&[from, to], Some(editor)) = (&self.points[..], &self.editor)
            && let Some(placement) = scaled(editor.placement(), [from, to], self.true_length)
        {
            self.place(placement);
        }
    }

    /// Whether the ground of the file is drawn.
    pub fn shows_ground(&self) -> bool {
        let is_placed = self.editor.as_ref().is_some_and(|editor| *editor.placement() != Similarity::IDENTITY);
        self.shown && (is_placed || matches!(self.tool, Some(Tool::Length | Tool::Ground | Tool::Gizmo)))
    }

    /// Places the model.
    pub fn place(&mut self, placement: Similarity) {
        self.step(|editor| editor.place(placement));
    }
}

impl Viewer {
    /// Keeps up with where the model was placed since the last picture. With the gizmo the ground of the file stands still, so the
    /// camera moves in the scene and stands on none of its views; else the scene stands still.
    pub(crate) fn follow_placement(&mut self) {
        let Some(placement) = self.edit.editor.as_ref().map(|editor| *editor.placement()) else { return };
        let before = self.edit.stood.replace(placement).unwrap_or(Similarity::IDENTITY);
        if self.edit.shown && self.edit.tool == Some(Tool::Gizmo) {
            if placement != before {
                self.navigator.place(&before.then(&placement.inverse()));
            }
            if placement != before || self.on_view.is_some() {
                self.has_moved();
            }
        } else if placement.rotation != before.rotation {
            // Orbits turn about what is up now.
            self.navigator.up = placement.rotation.transpose() * UP;
        }
    }
}
