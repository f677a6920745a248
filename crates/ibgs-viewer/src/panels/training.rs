//! How the training goes.

use crate::curves::Curves;
use crate::viewer::{Trained, Viewer};
use crate::worker::Command;
use eframe::egui::{self, ProgressBar, Ui};
use egui_plot::{Line, Plot, PlotPoints};
use ibgs_core::output::log::TrainingProgress;

/// Buttons, curves and measurements of the training.
pub fn training(viewer: &mut Viewer, ui: &mut Ui) {
    let Some(trained) = &viewer.training else { return };
    let progress = &trained.progress;
    ui.heading("Training");
    let share = progress.iteration as f32 / progress.iterations.max(1) as f32;
    let bar = ProgressBar::new(share).text(format!("{} of {}", progress.iteration, progress.iterations));
    ui.add(bar).on_hover_text("Iterations");
    let command = ui.horizontal_wrapped(|ui| buttons(trained, ui)).inner;
    ui.horizontal_wrapped(|ui| state(progress, ui));
    match (progress.loss, progress.psnr) {
        (Some(loss), Some(psnr)) => ui
            .label(format!("loss {loss:.4}   PSNR {psnr:.2} dB"))
            .on_hover_text("Means of the last iterations, on training photos"),
        _ => ui.weak("loss and PSNR come after some iterations"),
    };
    curves(&trained.curves, ui);
    if !progress.evaluations.is_empty() {
        ui.label("Held-out views").on_hover_text("Measured on photos that the training never saw");
        let grid = egui::Grid::new("evaluations").num_columns(4).striped(true);
        grid.show(ui, |ui| evaluations(progress, ui));
    }
    ui.separator();
    if let Some(command) = command {
        viewer.send(command);
    }
}

/// The command whose button was clicked.
fn buttons(trained: &Trained, ui: &mut Ui) -> Option<Command> {
    let (progress, running) = (&trained.progress, trained.running);
    let ended = progress.iteration >= progress.iterations;
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
    command
}

/// Stage, size of the model, time.
fn state(progress: &TrainingProgress, ui: &mut Ui) {
    let stage = match progress.stage {
        "base" => "the Gaussians alone, as in 3D Gaussian splatting",
        "surface" => "losses on depth and normals shape the surface",
        _ => "the network learns the residual from neighbouring photos",
    };
    ui.label(format!("stage: {}", progress.stage)).on_hover_text(stage);
    ui.label(format!("{} Gaussians", progress.gaussians));
    ui.label(format!("{:.0} s", progress.seconds)).on_hover_text("Time spent in iterations");
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
