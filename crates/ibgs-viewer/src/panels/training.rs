//! How the training goes.

use crate::OpenRequest;
use crate::curves::Curves;
use crate::panels::sides::table;
use crate::viewer::{End, Trained, Viewer};
use crate::worker::Command;
use eframe::egui::{self, ProgressBar, Ui};
use egui_plot::{Line, Plot, PlotPoints};
use ibgs_core::output::log::TrainingProgress;
use ibgs_core::progress::duration;
use std::path::Path;

/// Buttons, curves and measurements of the training.
pub fn training(viewer: &mut Viewer, ui: &mut Ui) {
    let Some(trained) = &viewer.training else { return };
    let progress = &trained.progress;
    ui.heading("Training");
    let share = progress.iteration as f32 / progress.iterations.max(1) as f32;
    let bar = ProgressBar::new(share).text(format!("{} of {}", progress.iteration, progress.iterations));
    ui.add(bar).on_hover_text("Iterations");
    let command = ui.horizontal_wrapped(|ui| buttons(trained, ui)).inner;
    ui.horizontal_wrapped(|ui| state(trained, ui));
    let model = viewer.scene.as_ref().and_then(|scene| scene.path.as_deref());
    let opens = trained.end.is_some_and(|end| ended(end, model, progress, ui));
    if let (Some(loss), Some(psnr)) = (progress.loss, progress.psnr) {
        ui.label(format!("loss {loss:.4}   PSNR {psnr:.2} dB"))
            .on_hover_text("Means of the last iterations, on training photos");
    } else if trained.end.is_none() {
        ui.weak("loss and PSNR come after some iterations");
    }
    // A training may end before them.
    if trained.end.is_none() || !trained.curves.psnr.is_empty() {
        curves(&trained.curves, ui);
    }
    if !progress.evaluations.is_empty() {
        ui.label("Held-out views").on_hover_text("Measured on photos that the training never saw");
        table(ui, "evaluations", 4, |ui| evaluations(progress, ui));
    }
    ui.separator();
    if let Some(command) = command {
        viewer.send(command);
    }
    if let Some(path) = viewer.scene.as_ref().and_then(|scene| scene.path.clone()).filter(|_| opens) {
        viewer.open(OpenRequest::Path(path));
    }
}

/// What comes after the training; whether its model is to be opened.
fn ended(end: End, model: Option<&Path>, progress: &TrainingProgress, ui: &mut Ui) -> bool {
    let early = progress.iteration < progress.iterations;
    ui.strong(match end {
        End::Failed => "Ended by an error.",
        End::Saved if early => "Stopped, and saved.",
        End::Saved => "Finished.",
    });
    let Some(model) = model else { return false };
    let model_is = if end == End::Failed { "What was saved is" } else { "The model is" };
    ui.label(format!("{model_is} in {}. It can be shared now; opened, it can be edited too.", model.display()));
    if early {
        ui.weak(format!("`ibgs train --resume -m {}` goes on.", model.display()));
    }
    ui.button("Open the model").clicked()
}

/// The command whose button was clicked.
fn buttons(trained: &Trained, ui: &mut Ui) -> Option<Command> {
    let (progress, running) = (&trained.progress, trained.running);
    let ended = trained.end.is_some() || progress.iteration >= progress.iterations;
    let mut command = None;
    let (name, text) = if running { ("Pause", "Stop until you go on") } else { ("Go on", "Train further") };
    if ui.add_enabled(!ended, egui::Button::new(name)).on_hover_text(text).clicked() {
        command = Some(Command::Run(!running));
    }
    let step = ui.add_enabled(!ended && !running, egui::Button::new("Step"));
    if step.on_hover_text("One iteration").clicked() {
        command = Some(Command::Step);
    }
    if ui.button("Save").on_hover_text("Write the model as it is now").clicked() {
        command = Some(Command::Save);
    }
    let stop = ui.add_enabled(!ended, egui::Button::new("Stop"));
    if stop.on_hover_text("End here: the model is saved and measured, and can be continued later").clicked() {
        command = Some(Command::End);
    }
    command
}

/// Stage, size of the model, time.
fn state(trained: &Trained, ui: &mut Ui) {
    let progress = &trained.progress;
    let stage = match progress.stage {
        "base" => "the Gaussians alone, as in 3D Gaussian splatting",
        "surface" => "losses on depth and normals shape the surface",
        _ => "the network learns the residual from neighbouring photos",
    };
    ui.label(format!("stage: {}", progress.stage)).on_hover_text(stage);
    ui.label(format!("{} Gaussians", progress.gaussians));
    ui.label(duration(progress.seconds)).on_hover_text("Time spent in iterations");
    if let Some(left) = progress.time_left().filter(|_| trained.running) {
        ui.label(left).on_hover_text("At the speed of late, with the stages to come; measuring and saving come on top");
    }
}

fn curves(curves: &Curves, ui: &mut Ui) {
    let curves = [
        ("PSNR (dB)", &curves.psnr, "Peak signal-to-noise ratio of recent training photos: higher is better"),
        ("loss", &curves.loss, "What the training makes smaller"),
        ("Gaussians", &curves.gaussians, "Densification adds Gaussians where the error is large"),
    ];
    for (name, points, meaning) in curves {
        ui.label(name).on_hover_text(meaning);
        let plot = Plot::new(name).height(90.0).show_axes([true, true]).allow_drag(false).allow_zoom(false);
        plot.allow_scroll(false).allow_boxed_zoom(false).show(ui, |plot| {
            plot.line(Line::new(name, PlotPoints::from(points.clone())).width(1.5));
        });
    }
}

/// The table of the scores of the held-out views.
fn evaluations(progress: &TrainingProgress, ui: &mut Ui) {
    for head in ["iteration", "", "PSNR", "SSIM"] {
        ui.strong(head);
    }
    ui.end_row();
    for evaluation in &progress.evaluations {
        let rows = [("base", Some(evaluation.base)), ("final", evaluation.image)];
        for (name, score) in rows.into_iter().filter_map(|(name, score)| Some((name, score?))) {
            ui.label(evaluation.iteration.to_string());
            ui.label(name);
            ui.label(format!("{:.2}", score.psnr));
            ui.label(format!("{:.4}", score.ssim));
            ui.end_row();
        }
    }
}
