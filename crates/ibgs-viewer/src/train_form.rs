//! The form that describes a training.

use crate::{OpenRequest, TrainingRequest};
use eframe::egui::{Grid, TextEdit, Ui};
use ibgs_core::config::{ExposureSwitch, Method, Preset, TrainConfig};
use std::path::PathBuf;

const METHODS: [(Method, &str, &str); 2] = [
    (Method::Ibgs, "IBGS", "Gaussians, and a residual that a network reads from neighbouring photos"),
    (Method::Gs3, "3DGS", "Plain 3D Gaussian splatting: faster, and without the residual"),
];

const PRESETS: [(Preset, &str, &str); 4] = [
    (Preset::Default, "default", "A length that follows the photos: the usual choice"),
    (Preset::Best, "best", "The highest image, in about four times the usual time"),
    (Preset::Fast, "fast", "A good image after half a minute on a fast GPU"),
    (Preset::Published, "published", "The options of the published experiments"),
];

const EXPOSURES: [(ExposureSwitch, &str, &str); 3] = [
    (ExposureSwitch::Auto, "auto", "Correct the photos' exposures if they differ"),
    (ExposureSwitch::On, "on", "Correct the photos' exposures in the whole training"),
    (ExposureSwitch::Off, "off", "Take the photos as they are"),
];

/// A text that stands for a path; what was chosen keeps names that are no text.
#[derive(Clone, Debug, Default)]
pub struct PathField {
    pub text: String,
    chosen: Option<PathBuf>,
}

impl PathField {
    /// Shows a path.
    pub fn set(&mut self, path: PathBuf) {
        self.text = path.display().to_string();
        self.chosen = Some(path);
    }

    /// The path; none where nothing is given.
    pub fn path(&self) -> Option<PathBuf> {
        match &self.chosen {
            Some(path) if path.to_string_lossy() == self.text => Some(path.clone()),
            _ => Some(self.text.trim()).filter(|text| !text.is_empty()).map(PathBuf::from),
        }
    }
}

/// What the user asks the form for.
pub enum Asked {
    /// A scene from a file dialog.
    Browse,
    /// Its training.
    Open(OpenRequest),
}

/// What the form holds.
#[derive(Debug)]
pub struct TrainForm {
    pub scene: PathField,
    pub is_demo: bool,
    preset: Preset,
    method: Method,
    /// As typed; empty: as usual.
    iterations: String,
    exposure: ExposureSwitch,
    /// Default number of the demo scene.
    demo_iterations: u32,
    /// Why it cannot be used, in one sentence.
    error: Option<String>,
}

impl TrainForm {
    /// An empty form.
    pub fn new(demo_iterations: u32) -> Self {
        Self {
            scene: PathField::default(),
            is_demo: false,
            preset: Preset::default(),
            method: Method::default(),
            iterations: String::new(),
            exposure: ExposureSwitch::default(),
            demo_iterations,
            error: None,
        }
    }

    /// Describes a training on this scene.
    pub fn set_scene(&mut self, path: PathBuf) {
        self.scene.set(path);
        (self.is_demo, self.error) = (false, None);
    }

    /// The training that it describes, or a sentence that says what is missing.
    fn request(&self) -> Result<TrainingRequest, String> {
        let scene = if self.is_demo { None } else { self.scene.path() };
        if scene.is_none() && !self.is_demo {
            return Err("choose a scene folder, or take the demo scene".to_owned());
        }
        let text = self.iterations.trim();
        let iterations = match text.parse() {
            _ if text.is_empty() => None,
            Ok(iterations) if iterations > 0 => Some(iterations),
            _ => return Err(format!("the length `{text}` is not a number of iterations; give a whole number from 1")),
        };
        let Self { preset, method, exposure, .. } = *self;
        Ok(TrainingRequest { scene, preset, method, iterations, exposure })
    }

    /// Shows the form; returns what was asked for.
    pub fn show(&mut self, ui: &mut Ui) -> Option<Asked> {
        let (room, mut browses) = ((ui.available_width() - 180.0).clamp(80.0, 260.0), false);
        Grid::new("training form").num_columns(2).spacing([12.0, 8.0]).show(ui, |ui| {
            ui.label("Photos");
            ui.horizontal(|ui| {
                ui.radio_value(&mut self.is_demo, false, "my scene");
                ui.radio_value(&mut self.is_demo, true, "demo scene")
                    .on_hover_text("A furnished room with a mirror ball, built in");
            });
            ui.end_row();
            let label = ui.label("Scene folder").id;
            ui.add_enabled_ui(!self.is_demo, |ui| {
                ui.horizontal(|ui| {
                    let field = TextEdit::singleline(&mut self.scene.text).hint_text("folder or .zip");
                    ui.add(field.desired_width(room))
                        .labelled_by(label)
                        .on_hover_text("Photos with their poses, of COLMAP, transforms.json or another program");
                    browses = ui.button("Browse...").clicked();
                });
            });
            ui.end_row();
            let before = self.preset;
            choices(ui, "Preset", &PRESETS, &mut self.preset);
            if self.preset != before {
                self.exposure = TrainConfig::preset(self.preset).exposure.enabled;
            }
            choices(ui, "Method", &METHODS, &mut self.method);
            let label = ui.label("Iterations").id;
            let usual = match TrainConfig::preset(self.preset).iterations {
                Some(iterations) => iterations.to_string(),
                None if self.is_demo => format!("{} (default)", self.demo_iterations),
                None => "by the photos".to_owned(),
            };
            let field = TextEdit::singleline(&mut self.iterations).hint_text(usual);
            ui.add(field.desired_width(120.0))
                .labelled_by(label)
                .on_hover_text("Length of the training; 7000 is a short one");
            ui.end_row();
            choices(ui, "Exposure", &EXPOSURES, &mut self.exposure);
        });
        ui.add_space(4.0);
        let clicked =
            ui.button("Train").on_hover_text("Begin; the model is written to a new folder in `output`").clicked();
        let wanted = clicked.then(|| self.request());
        if let Some(wanted) = &wanted {
            self.error = wanted.as_ref().err().cloned();
        }
        if let Some(error) = &self.error {
            let label = ui.colored_label(ui.visuals().error_fg_color, error);
            if clicked {
                label.scroll_to_me(None);
            }
        }
        match wanted {
            Some(request) => request.ok().map(|request| Asked::Open(OpenRequest::Train(request))),
            None => browses.then_some(Asked::Browse),
        }
    }
}

/// A row with one of several values.
fn choices<T: Copy + PartialEq>(ui: &mut Ui, name: &str, all: &[(T, &str, &str)], value: &mut T) {
    ui.label(name);
    ui.horizontal(|ui| {
        for (choice, name, meaning) in all {
            ui.selectable_value(value, *choice, *name).on_hover_text(*meaning);
        }
    });
    ui.end_row();
}
