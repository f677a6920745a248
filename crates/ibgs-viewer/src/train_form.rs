//! The form that describes a training.

use crate::{OpenRequest, TrainingRequest};
use eframe::egui::{Grid, TextEdit, Ui};
use ibgs_core::config::{ExposureSwitch, Method, Preset, TrainConfig};
use ibgs_core::dataset::{Masks, Resolution};
use ibgs_core::words::count;
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

const MASKS: [(Option<Masks>, &str, &str); 3] = [
    (None, "by the masks", "Empty where they leave one object in each photo, otherwise left out"),
    (Some(Masks::Ignore), "left out", "What lies outside of the masks does not count"),
    (Some(Masks::Object), "empty", "What lies outside of the masks is empty space around an object"),
];

/// What an empty number means.
const BY_PHOTOS: &str = "by the photos";
/// Width of a number in points.
const NUMBER: f32 = 120.0;

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
    /// As typed; empty: as they are.
    resolution: String,
    /// As typed; empty: by the photos.
    max_splats: String,
    masks: Option<Masks>,
    eval: bool,
    model: PathField,
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
            resolution: String::new(),
            max_splats: String::new(),
            masks: None,
            eval: false,
            model: PathField::default(),
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
        let text = self.max_splats.trim();
        let max_splats = match count(text) {
            None if !text.is_empty() => {
                return Err(format!("`{text}` is no number of Gaussians; write it as 5000, 100k or 1.5M"));
            }
            count => count,
        };
        let Self { preset, method, exposure, masks, eval, .. } = *self;
        let usual = TrainingRequest { preset, method, iterations, exposure, max_splats, ..TrainingRequest::default() };
        let model = self.model.path();
        if self.is_demo {
            return Ok(TrainingRequest { model, ..usual });
        }
        Ok(TrainingRequest { scene, model, resolution: self.resolution()?, masks, eval, ..usual })
    }

    /// Size of the photos.
    fn resolution(&self) -> Result<Resolution, String> {
        match self.resolution.trim() {
            "" => Ok(Resolution::default()),
            text => text.parse().map_err(|_| {
                format!("`{text}` is no size of photos; 1, 2, 4 or 8 divide it, a larger number is the width in pixels")
            }),
        }
    }

    /// Shows the form; returns what was asked for.
    pub fn show(&mut self, ui: &mut Ui) -> Option<Asked> {
        let (room, mut browses) = ((ui.available_width() - 190.0).clamp(80.0, 260.0), false);
        Grid::new("training form").num_columns(2).spacing([12.0, 8.0]).show(ui, |ui| {
            browses = self.source(room, ui);
            self.method(ui);
            self.photos(ui);
            let hint = "a new one in `output`";
            row(ui, "Model folder", &mut self.model.text, (hint, room), "What is written; it must be new or empty");
        });
        ui.add_space(4.0);
        let clicked = ui.button("Train").on_hover_text("Begin; you can watch it in this window").clicked();
        // What is missing is said until it is there.
        let wanted = (clicked || self.error.is_some()).then(|| self.request());
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
            Some(request) if clicked => request.ok().map(|request| Asked::Open(OpenRequest::Train(request))),
            _ => browses.then_some(Asked::Browse),
        }
    }

    /// What is trained on; whether a file dialog is asked for.
    fn source(&mut self, room: f32, ui: &mut Ui) -> bool {
        ui.label("Photos");
        ui.horizontal(|ui| {
            ui.radio_value(&mut self.is_demo, false, "my scene");
            ui.radio_value(&mut self.is_demo, true, "demo scene")
                .on_hover_text("A furnished room with a mirror ball, built in");
        });
        ui.end_row();
        let label = ui.label("Scene folder").id;
        let browses = ui.add_enabled_ui(!self.is_demo, |ui| {
            ui.horizontal(|ui| {
                let field = TextEdit::singleline(&mut self.scene.text).hint_text("folder or .zip");
                ui.add(field.desired_width(room))
                    .labelled_by(label)
                    .on_hover_text("Photos with their poses, of COLMAP, transforms.json or another program");
                ui.button("Browse...").clicked()
            })
        });
        ui.end_row();
        browses.inner.inner
    }

    /// How it is trained.
    fn method(&mut self, ui: &mut Ui) {
        let before = self.preset;
        choices(ui, "Preset", &PRESETS, &mut self.preset);
        if self.preset != before {
            self.exposure = TrainConfig::preset(self.preset).exposure.enabled;
        }
        choices(ui, "Method", &METHODS, &mut self.method);
        let usual = match TrainConfig::preset(self.preset).iterations {
            Some(iterations) => iterations.to_string(),
            None if self.is_demo => format!("{} (default)", self.demo_iterations),
            None => BY_PHOTOS.to_owned(),
        };
        row(ui, "Iterations", &mut self.iterations, (&usual, NUMBER), "Length of the training; 7000 is a short one");
        let hint = if self.is_demo { "as usual" } else { BY_PHOTOS };
        let text = "Most Gaussians, such as 500k or 1.5M: fewer take less memory and time, and show less";
        row(ui, "Gaussians", &mut self.max_splats, (hint, NUMBER), text);
    }

    /// How the photos are taken.
    fn photos(&mut self, ui: &mut Ui) {
        choices(ui, "Exposure", &EXPOSURES, &mut self.exposure);
        if self.is_demo {
            return;
        }
        let text = "Divided by 1, 2, 4 or 8; a larger number is the width in pixels";
        row(ui, "Photo size", &mut self.resolution, ("as they are", NUMBER), text);
        choices(ui, "Beyond masks", &MASKS, &mut self.masks);
        ui.label("Held out");
        ui.checkbox(&mut self.eval, "every 8th photo")
            .on_hover_text("Keep these photos out of the training, and measure the model on them");
        ui.end_row();
    }
}

/// A row with a text: its name, its hint and width, and what it means.
pub fn row(ui: &mut Ui, name: &str, text: &mut String, (hint, width): (&str, f32), meaning: &str) {
    let label = ui.label(name).id;
    let field = TextEdit::singleline(text).hint_text(hint);
    ui.add(field.desired_width(width)).labelled_by(label).on_hover_text(meaning);
    ui.end_row();
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
