//! *Share*: the model as a page, a bundle, or Gaussians for other programs.

use super::floating;
use crate::share::ShareKind;
use crate::viewer::{Over, Viewer};
use eframe::egui::{Button, ComboBox, Context, TextEdit};

/// Width in points, where the window has room for it.
const WIDTH: f32 = 420.0;

/// The panel, while it is shown.
pub fn share(viewer: &mut Viewer, ctx: &Context) {
    let Some(model) = viewer.shared_model() else {
        viewer.panels.put_over(Over::Share, false);
        return;
    };
    if viewer.share.model.as_ref() != Some(&model) && !viewer.share.runs {
        viewer.share.propose(&model);
    }
    let (mut open, mut writes) = (viewer.panels.over == Some(Over::Share), false);
    let width = WIDTH.min(ctx.content_rect().width() - 48.0);
    floating("Share", ctx).open(&mut open).show(ctx, |ui| {
        ui.set_width(width);
        let unsaved = viewer.edit.is_unsaved();
        let share = &mut viewer.share;
        ui.add_enabled_ui(!share.runs, |ui| {
            let before = share.kind;
            ui.horizontal(|ui| {
                let label = ui.label("Write as").id;
                let kinds = ComboBox::from_id_salt("kind").selected_text(share.kind.name()).show_ui(ui, |ui| {
                    for kind in ShareKind::of(&model) {
                        ui.selectable_value(&mut share.kind, kind, kind.name());
                    }
                });
                kinds.response.labelled_by(label);
            });
            if share.kind != before {
                share.propose(&model);
            }
            ui.label(share.kind.meaning(share.is_small));
            let label = ui.label(if share.kind == ShareKind::Page { "Folder" } else { "File" }).id;
            ui.add(TextEdit::singleline(&mut share.target.text).desired_width(f32::INFINITY)).labelled_by(label);
            if share.kind == ShareKind::Bundle {
                ui.checkbox(&mut share.is_small, "small").on_hover_text("Photos as JPEG, Gaussians as in SOG files");
            }
            ui.checkbox(&mut share.replaces, "replace what is there");
            if unsaved {
                ui.colored_label(
                    ui.visuals().warn_fg_color,
                    "What you have edited is not part of it: save the model, and open that.",
                );
            }
            writes = ui.add_enabled(share.target.path().is_some(), Button::new("Write")).clicked();
        });
        if share.runs {
            ui.horizontal(|ui| {
                ui.spinner();
                ui.label("writing");
            });
        }
        for line in &share.said {
            ui.label(line);
        }
    });
    viewer.panels.put_over(Over::Share, open);
    if let Some(request) = viewer.share.request(&model).filter(|_| writes) {
        viewer.write_shared(request);
    }
}
