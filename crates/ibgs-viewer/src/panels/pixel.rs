//! Why a pixel looks as it does.

use crate::marks;
use crate::panels::sides::table;
use crate::theme::as_text;
use crate::viewer::{Found, Viewer};
use eframe::egui::{self, Color32, Pos2, Rect, Sense, Ui, Vec2};
use ibgs_core::inspect::{Inspection, SourceReading, Verdict};
use ibgs_core::local_space::Length;

/// Height of the source photos in points, and its largest share of the window's.
const STRIP: f32 = 130.0;
const STRIP_SHARE: f32 = 0.2;

fn color(rgb: [f32; 3]) -> Color32 {
    let [r, g, b] = rgb.map(|v| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8);
    Color32::from_rgb(r, g, b)
}

/// A patch of a colour, with its numbers as tooltip.
fn patch(ui: &mut Ui, rgb: [f32; 3], text: &str) {
    let (rect, response) = ui.allocate_exact_size(Vec2::new(22.0, 16.0), Sense::hover());
    ui.painter().rect_filled(rect, 2.0, color(rgb));
    let [r, g, b] = rgb;
    response.on_hover_text(format!("{text}: {r:.3} {g:.3} {b:.3}"));
}

/// A share of one as a number and a bar.
fn share(ui: &mut Ui, value: f32) {
    ui.horizontal(|ui| {
        ui.label(format!("{value:.3}"));
        let (rect, _) = ui.allocate_exact_size(Vec2::new(60.0, 8.0), Sense::hover());
        ui.painter().rect_filled(rect, 2.0, ui.visuals().extreme_bg_color);
        let filled = Rect::from_min_size(rect.min, Vec2::new(rect.width() * value.clamp(0.0, 1.0), rect.height()));
        ui.painter().rect_filled(filled, 2.0, marks::SOURCE);
    });
}

/// What became of a source at the pixel, in a word and in a sentence.
fn verdict(reading: &SourceReading) -> (String, &'static str) {
    match reading.verdict {
        Verdict::Used { number } => (format!("read ({})", number + 1), "The network reads this photo at the pixel"),
        Verdict::Behind => ("behind".to_owned(), "The point lies behind this camera"),
        Verdict::Outside => ("outside".to_owned(), "The point falls outside of this photo"),
        Verdict::NoDepth => ("no depth".to_owned(), "From this camera nothing is met there"),
        Verdict::Hidden => {
            ("hidden".to_owned(), "From this camera something else stands before the point: the depths disagree")
        }
        Verdict::Unreadable => ("masked".to_owned(), "All that could be read here is masked or outside"),
        Verdict::Enough => ("not needed".to_owned(), "It sees the point, but enough better photos do"),
    }
}

fn name(viewer: &Viewer, found: &Found, source: usize) -> String {
    let view = found.views.get(source).copied().flatten();
    let name = view.and_then(|index| Some(viewer.scene.as_ref()?.views.get(index)?.name.clone()));
    let name = name.unwrap_or_else(|| format!("photo {}", found.inspection.sources[source].view));
    name.rsplit('/').next().unwrap_or(&name).to_owned()
}

/// The figures of the pixel that was clicked.
pub fn pixel(viewer: &mut Viewer, ui: &mut Ui) {
    let Some(found) = &viewer.found else { return };
    let inspection = &found.inspection;
    let mut close = false;
    ui.horizontal(|ui| {
        ui.heading(format!("Pixel {}, {}", inspection.pixel[0], inspection.pixel[1]));
        close = ui.small_button("Close").clicked();
    });
    ui.horizontal_wrapped(|ui| composition(inspection, ui));
    depth(inspection, ui);
    if !inspection.intersections.is_empty() {
        ui.separator();
        ui.strong("Median intersections").on_hover_text(
            "The Gaussians around the median depth that the ray meets, front to back: the photos are read at each of them",
        );
        table(ui, "intersections", 3, |ui| intersections_table(inspection, ui));
    }
    if !inspection.sources.is_empty() {
        ui.separator();
        ui.strong("Source photos").on_hover_text("Photos of neighbouring views, in the order in which they are tested");
        table(ui, "sources", 4, |ui| sources_table(viewer, found, ui));
    }
    if close {
        viewer.found = None;
    }
}

/// What the pixel's colour is the sum of.
fn composition(inspection: &Inspection, ui: &mut Ui) {
    ui.label("base").on_hover_text("Colour of the Gaussians alone");
    patch(ui, inspection.base, "base");
    if let (Some(residual), Some(image)) = (inspection.residual, inspection.image) {
        let [r, g, b] = residual;
        ui.label("+ residual").on_hover_text("What the network and the source photos add, around grey");
        patch(ui, residual.map(|v| 0.5 + v), "0.5 + residual");
        ui.label("= final");
        patch(ui, image, "final");
        ui.end_row();
        ui.weak(format!("residual {r:+.3} {g:+.3} {b:+.3}"));
    }
}

/// The median depth, and the point there.
fn depth(inspection: &Inspection, ui: &mut Ui) {
    match inspection.median_depth {
        Some(depth) => ui
            .label(format!("median depth {}", Length(depth.into())))
            .on_hover_text("Depth where half of the light is stopped: the point that is looked up in the photos"),
        None => ui.label("nothing is met here: there is no surface to ask the photos about"),
    };
    if let Some(p) = inspection.point {
        let place = p.to_array().map(|v| Length(v).to_string()).join(" ");
        ui.label(format!("at {place}")).on_hover_text("That point in the scene's own coordinates");
    }
}

/// The first row of a table: words, with what they mean as tooltip.
fn heads(heads: &[(&str, &str)], ui: &mut Ui) {
    for (head, text) in heads {
        ui.weak(*head).on_hover_text(*text);
    }
    ui.end_row();
}

/// The table of the median intersections.
fn intersections_table(inspection: &Inspection, ui: &mut Ui) {
    let depth = ("depth", "Where the ray meets the Gaussian's plane");
    heads(&[depth, ("weight", "Its share of the pixel's colour"), ("", "")], ui);
    for hit in &inspection.intersections {
        ui.label(Length(hit.depth.into()).to_string());
        share(ui, hit.weight);
        ui.weak(if hit.before { "before the median" } else { "behind it" });
        ui.end_row();
    }
}

/// The table of the source photos.
fn sources_table(viewer: &Viewer, found: &Found, ui: &mut Ui) {
    let columns = [
        ("photo", "Name of the photo"),
        ("", "Whether the network reads it here"),
        ("depth error", "How far the depth seen from there is off, relative; seen below the limit"),
        ("colours", "The photo's colour at each intersection, and their mean, which the network reads"),
    ];
    heads(&columns, ui);
    for (index, reading) in found.inspection.sources.iter().enumerate() {
        ui.label(name(viewer, found, index));
        source_cells(reading, ui);
        ui.end_row();
    }
}

/// What was read from a source photo: the cells after its name.
fn source_cells(reading: &SourceReading, ui: &mut Ui) {
    let (word, text) = verdict(reading);
    match reading.verdict {
        Verdict::Used { .. } => ui.colored_label(as_text(marks::SOURCE, ui.visuals()), word),
        _ => ui.weak(word),
    }
    .on_hover_text(text);
    match reading.depth_error {
        Some(error) => ui.label(format!("{:.2}%", 100.0 * error)),
        None => ui.label("-"),
    }
    .on_hover_text(format!("limit {:.2}%", 100.0 * reading.depth_limit));
    ui.horizontal(|ui| {
        for read in reading.reads.iter().flatten() {
            patch(ui, *read, "at an intersection");
        }
        if let Some(mean) = reading.color {
            ui.label("=");
            patch(ui, mean, "mean by weight");
        }
    });
}

/// The source photos below the image, with the point marked.
pub fn strip(viewer: &mut Viewer, ui: &mut Ui) {
    let Some(found) = &viewer.found else { return };
    let (Some(scene), true) = (&viewer.scene, !found.inspection.sources.is_empty()) else { return };
    let sources = found.inspection.sources.iter().zip(&found.views).enumerate();
    let shown: Vec<_> = sources.filter_map(|(at, (reading, view))| Some((at, reading, (*view)?))).collect();
    if shown.is_empty() {
        return;
    }
    let (thumbnails, mut chosen) = (&mut viewer.thumbnails, None);
    let height = STRIP.min(STRIP_SHARE * ui.ctx().content_rect().height());
    egui::Panel::bottom("sources").show(ui, |ui| {
        egui::ScrollArea::horizontal().auto_shrink([false, true]).show(ui, |ui| {
            ui.horizontal(|ui| {
                for (_, reading, index) in shown {
                    let view = &scene.views[index];
                    let ratio = view.camera.width as f32 / view.camera.height.max(1) as f32;
                    let (rect, response) = ui.allocate_exact_size(Vec2::new(height * ratio, height), Sense::click());
                    let painter = ui.painter_at(rect);
                    if let Some(texture) = thumbnails.of(ui.ctx(), index, view) {
                        let whole = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
                        painter.image(texture.id(), rect, whole, Color32::WHITE);
                    }
                    let used = matches!(reading.verdict, Verdict::Used { .. });
                    if let Some(place) = reading.place {
                        let size = glam::DVec2::new(view.camera.width.into(), view.camera.height.into());
                        let share = place / size;
                        marks::cross(&painter, rect.min + Vec2::new(share.x as f32, share.y as f32) * rect.size());
                    }
                    let stroke = if used { marks::SOURCE } else { Color32::from_gray(110) };
                    painter.rect_stroke(rect, 0.0, egui::Stroke::new(2.0, stroke), egui::StrokeKind::Inside);
                    let (word, text) = verdict(reading);
                    super::label(&painter, rect.min + Vec2::splat(8.0), egui::Align2::LEFT_TOP, word);
                    let response = response.on_hover_text(format!("{}: {text}. Click to stand there.", view.name));
                    if response.clicked() {
                        chosen = Some(index);
                    }
                }
            });
        });
    });
    if let Some(index) = chosen {
        viewer.stand_on(index);
    }
}
