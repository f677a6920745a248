//! Small drawings beside words, in lines of the text's colour.

use crate::edit::Tool;
use eframe::egui::{
    Atom, AtomKind, AtomPaintArgs, Color32, IntoSizedResult, Painter, Rect, Shape, SizedAtomKind, Stroke, Ui, Vec2,
};
use std::sync::Arc;

/// A drawing: lines through points of a square, from 0 at the left and the top to 16.
pub type Icon = &'static [&'static [[f32; 2]]];

const SIDE: f32 = 16.0;

pub const FOLDER: Icon = &[&[[2., 13.], [2., 4.], [6., 4.], [8., 6.], [14., 6.], [14., 13.], [2., 13.]]];
pub const EYE: Icon = &[
    &[[1., 8.], [4., 5.], [8., 4.], [12., 5.], [15., 8.], [12., 11.], [8., 12.], [4., 11.], [1., 8.]],
    &[[6., 8.], [7., 6.5], [9., 6.5], [10., 8.], [9., 9.5], [7., 9.5], [6., 8.]],
];
pub const CAMERA: Icon = &[
    &[[2., 13.], [2., 5.], [5., 5.], [6., 3.], [10., 3.], [11., 5.], [14., 5.], [14., 13.], [2., 13.]],
    &[[5.5, 9.], [6.5, 7.], [9.5, 7.], [10.5, 9.], [9.5, 11.], [6.5, 11.], [5.5, 9.]],
];
pub const PENCIL: Icon = &[&[[2., 14.], [3., 10.], [11., 2.], [14., 5.], [6., 13.], [2., 14.]], &[[9., 4.], [12., 7.]]];
/// An arrow that leaves a tray.
pub const SHARE: Icon =
    &[&[[2., 9.], [2., 14.], [14., 14.], [14., 9.]], &[[8., 10.], [8., 2.]], &[[5., 5.], [8., 2.], [11., 5.]]];
/// There is a menu below.
pub const DOWN: Icon = &[&[[5., 6.5], [8., 9.5], [11., 6.5]]];
/// Where a panel goes, or comes from.
pub const UP: Icon = &[&[[5., 9.5], [8., 6.5], [11., 9.5]]];
pub const LEFT: Icon = &[&[[9.5, 5.], [6.5, 8.], [9.5, 11.]]];
pub const RIGHT: Icon = &[&[[6.5, 5.], [9.5, 8.], [6.5, 11.]]];
/// A strip of film.
pub const FILM: Icon = &[
    &[[2., 3.], [14., 3.], [14., 13.], [2., 13.], [2., 3.]],
    &[[5., 3.], [5., 13.]],
    &[[11., 3.], [11., 13.]],
    &[[2., 8.], [5., 8.]],
    &[[11., 8.], [14., 8.]],
];
const RECTANGLE: Icon = &[&[[2., 4.], [14., 4.], [14., 12.], [2., 12.], [2., 4.]]];
const LASSO: Icon = &[&[
    [5., 10.],
    [2., 8.],
    [2., 5.],
    [5., 3.],
    [11., 3.],
    [14., 5.],
    [14., 8.],
    [11., 10.],
    [6., 10.],
    [5., 12.],
    [3., 14.],
]];
const POLYGON: Icon = &[&[[3., 13.], [2., 6.], [9., 2.], [14., 8.], [9., 9.], [11., 14.], [3., 13.]]];
const BRUSH: Icon =
    &[&[[14., 2.], [7., 9.]], &[[7., 9.], [5., 9.], [4., 12.], [2., 14.], [6., 13.5], [8., 11.], [7., 9.]]];
const SPHERE: Icon = &[
    &[[8., 2.], [12., 4.], [14., 8.], [12., 12.], [8., 14.], [4., 12.], [2., 8.], [4., 4.], [8., 2.]],
    &[[2., 8.], [5., 10.], [11., 10.], [14., 8.]],
];
const BOX: Icon = &[
    &[[2., 5.], [8., 2.], [14., 5.], [14., 11.], [8., 14.], [2., 11.], [2., 5.], [8., 8.], [14., 5.]],
    &[[8., 8.], [8., 14.]],
];
const DROP: Icon = &[&[[8., 2.], [12., 8.], [12., 11.], [10., 14.], [6., 14.], [4., 11.], [4., 8.], [8., 2.]]];
const FLOOD: Icon = &[
    &[[6., 2.], [13., 8.], [7., 14.], [2., 9.], [8., 4.]],
    &[[2., 9.], [12., 9.]],
    &[[14., 11.], [15., 13.], [13., 13.], [14., 11.]],
];
const RULER: Icon = &[
    &[[1., 6.], [15., 6.], [15., 11.], [1., 11.], [1., 6.]],
    &[[4., 6.], [4., 8.]],
    &[[8., 6.], [8., 9.]],
    &[[12., 6.], [12., 8.]],
];
const GROUND: Icon = &[&[[1., 12.], [15., 12.]], &[[8., 12.], [8., 3.]], &[[5., 6.], [8., 3.], [11., 6.]]];
const GIZMO: Icon = &[
    &[[8., 15.], [8., 1.]],
    &[[1., 8.], [15., 8.]],
    &[[6., 3.], [8., 1.], [10., 3.]],
    &[[13., 6.], [15., 8.], [13., 10.]],
    &[[6., 13.], [8., 15.], [10., 13.]],
    &[[3., 6.], [1., 8.], [3., 10.]],
];

/// That of a tool.
pub fn of(tool: Tool) -> Icon {
    match tool {
        Tool::Rectangle => RECTANGLE,
        Tool::Lasso => LASSO,
        Tool::Polygon => POLYGON,
        Tool::Brush => BRUSH,
        Tool::Sphere => SPHERE,
        Tool::Box => BOX,
        Tool::Color => DROP,
        Tool::Flood => FLOOD,
        Tool::Length => RULER,
        Tool::Ground => GROUND,
        Tool::Gizmo => GIZMO,
    }
}

/// A drawing in a room.
pub fn draw(painter: &Painter, lines: Icon, room: Rect, color: Color32) {
    for line in lines {
        let points = line.iter().map(|[x, y]| room.min + Vec2::new(*x, *y) / SIDE * room.size()).collect();
        painter.add(Shape::line(points, Stroke::new(1.2, color)));
    }
}

/// A drawing in a button, of the size of a checkbox.
pub fn icon(lines: Icon) -> Atom<'static> {
    let kind = AtomKind::closure(move |ui, _| {
        let size = Vec2::splat(ui.spacing().icon_width);
        let paint = move |ui: &Ui, args: AtomPaintArgs| {
            draw(ui.painter(), lines, Rect::from_center_size(args.rect.center(), size), args.fallback_text_color);
        };
        IntoSizedResult { intrinsic_size: size, sized: SizedAtomKind::Paint { paint: Arc::new(paint), size } }
    });
    kind.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drawings_stay_in_their_square() {
        let tools = Tool::SELECTING.iter().chain(&Tool::PLACING).map(|(tool, ..)| of(*tool));
        for drawing in tools.chain([FOLDER, EYE, CAMERA, PENCIL, FILM, SHARE, UP, DOWN, LEFT, RIGHT]) {
            assert!(drawing.iter().all(|line| line.len() > 1));
            assert!(drawing.iter().copied().flatten().flatten().all(|place| (0.0..=SIDE).contains(place)));
        }
    }
}
