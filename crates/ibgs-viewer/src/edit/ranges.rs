//! Selection by a value of the Gaussians: the value, its histogram and the range that is wanted.

use eframe::egui::Context;
use glam::DVec3;
use ibgs_core::camera::Camera;
use ibgs_core::edit::{Editor, Histogram, Mask, Value, in_range};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};

/// The value that is looked at.
#[derive(Default)]
pub struct Ranges {
    /// Which one; none: none yet.
    pub value: Option<Value>,
    /// Comes from a thread, as counting photos takes a while.
    coming: Option<Receiver<Vec<f32>>>,
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
            let _ = sender.send(value.of(&gaussians, middle, &cameras));
            window.request_repaint();
        });
        *self = Self { value: Some(value), coming: started.ok().map(|_| coming), ..Self::default() };
    }

    /// The histogram of what is shown; none while the values are not there, or where there are none.
    pub fn histogram(&mut self, shown: &Arc<Mask>) -> Option<&Histogram> {
        if let Some(values) = self.coming.as_ref().and_then(|coming| coming.try_recv().ok()) {
            (self.values, self.coming, self.histogram) = (values, None, None);
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
