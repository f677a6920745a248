//! The question what becomes of unsaved edits.

use super::edit::file;
use crate::viewer::{Answer, Next, Viewer};
use eframe::egui::{Button, Context, Id, Modal};

/// Width of the question in points, where the window has room for it.
const WIDTH: f32 = 380.0;

/// Asks, while there is something to ask.
pub fn leaving(viewer: &mut Viewer, ctx: &Context) {
    let Some(leaving) = &viewer.leaving else { return };
    let (saving, closes) = (leaving.saving, matches!(leaving.next, Next::Close));
    let shown = Modal::new(Id::unique("leaving")).show(ctx, |ui| {
        ui.set_width(WIDTH.min(ctx.content_rect().width() - 48.0));
        ui.heading("Save the edited model?");
        ui.label(match closes {
            true => "The window is about to close. What you have edited is not saved.",
            false => "Another model is about to take its place. What you have edited is not saved.",
        });
        ui.add_space(4.0);
        ui.add_enabled_ui(!saving, |ui| file(&mut viewer.edit, ui));
        if let Some(error) = &viewer.error {
            ui.colored_label(ui.visuals().error_fg_color, error);
        }
        ui.add_space(4.0);
        ui.horizontal(|ui| {
            let mut answer = None;
            if saving {
                ui.spinner();
            }
            let choices = [("Save", Answer::Save), ("Discard", Answer::Discard), ("Cancel", Answer::Cancel)];
            for (name, choice) in choices {
                let enabled = !saving || choice == Answer::Cancel;
                if ui.add_enabled(enabled, Button::new(name)).clicked() {
                    answer = Some(choice);
                }
            }
            answer
        })
        .inner
    });
    let cancelled = shown.should_close().then_some(Answer::Cancel);
    if let Some(answer) = shown.inner.or(cancelled) {
        viewer.answered(answer, ctx);
    }
}
