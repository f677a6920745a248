//! Where the panels beside the picture stand, and the tabs at the picture's edges that fold them. In a small window the picture
//! keeps at least three fifths of its width.

use super::{edit, path, pixel, training, views};
use crate::IN_BROWSER;
use crate::icons::{self, Icon, draw};
use crate::viewer::Viewer;
use eframe::egui::{
    self, Context, Grid, Id, Panel, Pos2, Rect, Role, ScrollArea, Sense, Ui, UiBuilder, Vec2, WidgetInfo,
};

/// Windows that are narrower, in points, have no room for panels on both sides.
pub const SMALL: f32 = 900.0;
/// Windows that are narrower have below the picture what others have beside it.
pub const NARROW: f32 = 480.0;
/// In narrower windows of a browser the views are folded at first.
const NARROW_PAGE: f32 = 560.0;
/// Largest share of a small window's width, or of the height of its rest, that the panel of facts takes.
const SHARE: f32 = 0.35;
/// Room for indent, value and name beside a slider in points.
const BESIDE_SLIDER: f32 = 160.0;
/// Size of a tab, the longer side along the edge.
const TAB: Vec2 = Vec2::new(16.0, 44.0);

/// Whether the window is as narrow as that of a phone.
pub fn is_narrow(ctx: &Context) -> bool {
    ctx.content_rect().width() < NARROW
}

/// Where the facts stand: training, editor, camera path, pixel.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Place {
    Beside,
    Below,
}

fn place(ctx: &Context) -> Place {
    let room = ctx.content_rect();
    let is_tall = room.width() < SMALL && room.height() > room.width();
    if is_narrow(ctx) || is_tall { Place::Below } else { Place::Beside }
}

fn shows_pixel(viewer: &Viewer) -> bool {
    viewer.panels.shows_pixel && viewer.found.is_some()
}

fn has_facts(viewer: &Viewer) -> bool {
    viewer.training.is_some() || shows_pixel(viewer) || viewer.panels.shows_path || viewer.edit.shown
}

/// Whether the facts take the room of the views.
fn are_views_crowded_out(viewer: &Viewer, ctx: &Context) -> bool {
    let is_small = ctx.content_rect().width() < SMALL;
    is_small && place(ctx) == Place::Beside && has_facts(viewer) && !viewer.panels.folds_facts
}

/// Whether the views are folded.
fn are_views_folded(viewer: &Viewer, ctx: &Context) -> bool {
    let at_first = IN_BROWSER && ctx.content_rect().width() < NARROW_PAGE;
    viewer.panels.folds_views.unwrap_or(at_first) || are_views_crowded_out(viewer, ctx)
}

/// The views at the left, the facts at the right or below, the photos of the pixel below.
pub fn sides(viewer: &mut Viewer, ui: &mut Ui) {
    if !are_views_folded(viewer, ui.ctx()) {
        views::views(viewer, ui);
    }
    if has_facts(viewer) && !viewer.panels.folds_facts {
        facts(viewer, ui);
    }
    if shows_pixel(viewer) {
        pixel::strip(viewer, ui);
    }
}

fn facts(viewer: &mut Viewer, ui: &mut Ui) {
    let panel = match place(ui.ctx()) {
        Place::Below => {
            let most = (SHARE * ui.available_height()).max(80.0);
            Panel::bottom("facts below").default_size(most).max_size(most)
        }
        Place::Beside => {
            let width = ui.ctx().content_rect().width();
            // Each with a width of its own, which the user may change.
            let (name, share) = match width < SMALL {
                true => ("small facts", SHARE),
                // Its table is wide, and a panel does not get narrower by itself.
                false if shows_pixel(viewer) => ("facts of a pixel", 0.5),
                false => ("facts", 0.5),
            };
            let most = (share * width).max(120.0);
            Panel::right(name).default_size(300.0_f32.min(most)).max_size(most)
        }
    };
    panel.show(ui, |ui| in_any_place("facts in any place", ui, |ui| scrolled_facts(viewer, ui)));
}

/// What a panel holds. What is open and how far it is scrolled stays when the panel changes its place.
pub fn in_any_place(name: &str, ui: &mut Ui, content: impl FnOnce(&mut Ui)) {
    ui.scope_builder(UiBuilder::new().scope_id(Id::unique(name)), content);
}

fn scrolled_facts(viewer: &mut Viewer, ui: &mut Ui) {
    ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
        // Beside a slider there is room for its value and its name.
        ui.spacing_mut().slider_width = (ui.available_width() - BESIDE_SLIDER).clamp(40.0, 100.0);
        training::training(viewer, ui);
        edit::panel(viewer, ui);
        if viewer.panels.shows_path {
            path::panel(viewer, ui);
        }
        if shows_pixel(viewer) {
            pixel::pixel(viewer, ui);
        }
    });
}

/// A table of the facts; in a small window it scrolls sideways, so that the panel keeps its width.
pub fn table(ui: &mut Ui, name: &str, columns: usize, rows: impl FnOnce(&mut Ui)) {
    let grid = Grid::new(name).num_columns(columns).striped(true);
    match ui.ctx().content_rect().width() < SMALL {
        true => _ = ScrollArea::horizontal().id_salt(name).show(ui, |ui| grid.show(ui, rows)),
        false => _ = grid.show(ui, rows),
    }
}

/// The tabs at the edges of the picture.
pub fn tabs(viewer: &mut Viewer, ui: &Ui, room: Rect) {
    let along = Rect::from_center_size(room.center(), TAB);
    if viewer.scene.as_ref().is_some_and(|scene| !scene.views.is_empty()) {
        let folded = are_views_folded(viewer, ui.ctx());
        let (name, icon) = if folded { ("Show the views", icons::RIGHT) } else { ("Fold the views", icons::LEFT) };
        let at = Rect::from_min_size(Pos2::new(room.left(), along.top()), TAB);
        if tab(ui, at, name, icon) {
            // In a small window they take the room of the facts.
            viewer.panels.folds_facts |= are_views_crowded_out(viewer, ui.ctx());
            viewer.panels.folds_views = Some(!folded);
        }
    }
    if has_facts(viewer) {
        let folded = viewer.panels.folds_facts;
        let name = if folded { "Show the panel" } else { "Fold the panel" };
        let (at, icons) = match place(ui.ctx()) {
            Place::Beside => {
                (Rect::from_min_size(Pos2::new(room.right() - TAB.x, along.top()), TAB), [icons::RIGHT, icons::LEFT])
            }
            Place::Below => {
                let size = Vec2::new(TAB.y, TAB.x);
                let corner = Pos2::new(room.right() - size.x - TAB.x, room.bottom() - size.y);
                (Rect::from_min_size(corner, size), [icons::DOWN, icons::UP])
            }
        };
        if tab(ui, at, name, icons[usize::from(folded)]) {
            viewer.panels.folds_facts = !folded;
        }
    }
}

/// A tab; whether it was clicked.
fn tab(ui: &Ui, at: Rect, name: &'static str, icon: Icon) -> bool {
    let response = ui.interact(at, ui.scope_id().with(name), Sense::click());
    response.widget_info(|| WidgetInfo::labeled(Role::Button, true, name));
    let visuals = ui.style().interact(&response);
    ui.painter().rect(at, 3.0, visuals.bg_fill, visuals.bg_stroke, egui::StrokeKind::Inside);
    let side = Rect::from_center_size(at.center(), Vec2::splat(TAB.x));
    draw(ui.painter(), icon, side, visuals.fg_stroke.color);
    response.on_hover_text(name).clicked()
}
