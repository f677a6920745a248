//! Selection by a value of the Gaussians: the value, its histogram and the range that is wanted.

use crate::edit_work::{Compared, Comparison, EditCommand};
use crate::{Scene, View};
use eframe::egui::Context;
use glam::DVec3;
use ibgs_core::camera::Camera;
use ibgs_core::edit::{Editor, Histogram, Mask, Value, in_range};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

/// What Gaussians can be selected by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// What they themselves have.
    Own(Value),
    /// The error of the base image where they are seen.
    Error,
}

impl Quantity {
    /// Whether values of several orders of magnitude are told apart.
    pub fn is_logarithmic(self) -> bool {
        match self {
            Self::Own(value) => value.is_logarithmic(),
            Self::Error => true,
        }
    }
}

/// The value that is looked at.
#[derive(Default)]
pub struct Ranges {
    /// Which one; none: none yet.
    pub value: Option<Quantity>,
    /// Comes from another thread, as counting photos and comparing with them takes a while.
    coming: Option<Receiver<Compared>>,
    /// There are no photos for the error.
    pub has_no_photos: bool,
    /// Photos that were compared with, and their number.
    pub compared: Option<[usize; 2]>,
    values: Vec<f32>,
    /// How often which value occurs, and among which Gaussians.
    histogram: Option<(Arc<Mask>, Histogram)>,
    /// What is wanted; none: all.
    pub range: Option<[f32; 2]>,
}

impl Ranges {
    /// Looks at another value.
    pub fn show(&mut self, value: Value, editor: &Editor, middle: DVec3, cameras: Vec<Camera>, window: &Context) {
        let (sender, coming) = channel();
        let (gaussians, window) = (editor.gaussians().clone(), window.clone());
        let started = std::thread::Builder::new().name("values".to_owned()).spawn(move || {
            // The receiver is gone once another value is looked at.
            let _ = sender.send(Compared::Values(value.of(&gaussians, middle, &cameras)));
            window.request_repaint();
        });
        let value = Some(Quantity::Own(value));
        *self = Self { value, coming: started.ok().map(|_| coming), ..Self::default() };
    }

    /// Looks at the error against photos, which the worker is asked for; without photos there is none.
    pub fn show_error(&mut self, scene: &Scene) -> Option<EditCommand> {
        *self = Self { value: Some(Quantity::Error), ..Self::default() };
        let photo = |view: &View| {
            let size = [view.camera.width, view.camera.height];
            Some((view.camera, view.photo.clone().filter(|photo| photo.size() == size)?))
        };
        let photos: Vec<_> = scene.views.iter().filter_map(photo).collect();
        self.has_no_photos = photos.is_empty();
        if photos.is_empty() {
            return None;
        }
        let of_object = scene.model.as_ref().is_some_and(|model| model.config.data.shows_object());
        let (told, coming) = channel();
        self.coming = Some(coming);
        Some(EditCommand::Compare(Comparison { photos, of_object, told }))
    }

    /// The histogram of what is shown; none while the values are not there, or where there are none.
    pub fn histogram(&mut self, shown: &Arc<Mask>) -> Option<&Histogram> {
        while let Some(coming) = &self.coming {
            match coming.try_recv() {
                Ok(Compared::Photos(done, count)) => self.compared = Some([done, count]),
                Ok(Compared::Values(values)) => (self.values, self.coming, self.histogram) = (values, None, None),
                Err(TryRecvError::Empty) => break,
                // It failed, which is said elsewhere.
                Err(TryRecvError::Disconnected) => self.coming = None,
            }
        }
        if self.values.len() != shown.total() {
            return None;
        }
        if self.histogram.as_ref().is_none_or(|(of, _)| of != shown) {
            let histogram = Histogram::of(&self.values, shown, self.value?.is_logarithmic());
            self.histogram = histogram.map(|histogram| (shown.clone(), histogram));
        }
        self.histogram.as_ref().map(|(_, histogram)| histogram)
    }

    /// Whether the values are still to come.
    pub fn is_waiting(&self) -> bool {
        self.coming.is_some()
    }

    /// The Gaussians in the range.
    pub fn found(&self) -> Option<Mask> {
        let (_, histogram) = self.histogram.as_ref()?;
        Some(in_range(&self.values, self.range.unwrap_or(histogram.ends)))
    }
}
