//! The editor's tools: what the pointer selects in the image.

use super::Edit;
use crate::worker::Rendered;
use glam::{DVec2, DVec3};
use ibgs_core::camera::Camera;
use ibgs_core::edit::{Ball, Combine, Editor, Flood, Mask, Screen, color, nearest, of_color};
use std::sync::Arc;

/// A polygon is closed by a click this near to its first or last corner, in heights of the image.
const CLOSES: f64 = 0.015;

/// What the pointer does in the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tool {
    /// Drags a rectangle.
    Rectangle,
    /// Draws an outline.
    Lasso,
    /// Sets the corners of an outline.
    Polygon,
    /// Paints.
    Brush,
    /// Drags a ball around a point of the surface.
    Sphere,
    /// Drags the faces of a box.
    Box,
    /// Picks a colour.
    Color,
    /// Picks what hangs together with a point of the surface.
    Flood,
    /// Measures from one point of the surface to another.
    Length,
    /// Sets the ground by three points of the surface.
    Ground,
    /// Moves, turns and scales by handles.
    Gizmo,
}

impl Tool {
    /// Those that select, with what they are called and how they are used.
    pub const SELECTING: [(Self, &str, &str); 8] = [
        (Self::Rectangle, "Rectangle", "Drag a rectangle with the left button."),
        (Self::Lasso, "Lasso", "Draw around what is to be selected with the left button."),
        (Self::Polygon, "Polygon", "Click the corners. A double click, Enter or a click on the first corner ends it."),
        (Self::Brush, "Brush", "Paint with the left button."),
        (Self::Sphere, "Sphere", "Press on the surface and drag: a ball around that point."),
        (Self::Box, "Box", "A box in the scene, with handles on its faces."),
        (Self::Color, "Colour", "Click on the surface: all Gaussians of a like colour."),
        (Self::Flood, "Flood", "Click on the surface: all that hangs together with that point."),
    ];

    /// Those that place the model.
    pub const PLACING: [(Self, &str, &str); 3] = [
        (
            Self::Gizmo,
            "Gizmo",
            "Drag an arrow to move the model, a ring to turn it, the middle to scale it. The ground stands still meanwhile.",
        ),
        (Self::Length, "Measure", "Click two points of the surface: their distance."),
        (Self::Ground, "Ground", "Click three points of the ground: they come to lie at height 0, with up as -y."),
    ];

    /// Whether the pointer's main button is the tool's, not the camera's.
    pub fn takes_pointer(self) -> bool {
        !matches!(self, Self::Box | Self::Gizmo)
    }

    /// Whether what lies behind the surface can be left out.
    pub fn has_front(self) -> bool {
        matches!(self, Self::Rectangle | Self::Lasso | Self::Polygon | Self::Brush)
    }

    /// Whether it works on points of the surface.
    fn needs_surface(self) -> bool {
        matches!(self, Self::Sphere | Self::Color | Self::Flood | Self::Length | Self::Ground)
    }
}

/// The picture that the pointer is over.
pub struct Picture<'a> {
    /// Its camera.
    pub camera: &'a Camera,
    /// The last frame, which may be of another camera.
    pub last: Option<&'a Rendered>,
    /// Radius of the brush in heights of the image.
    pub radius: f64,
}

impl Picture<'_> {
    /// The depths of the last frame, if it is of this camera, with its size.
    fn depths(&self) -> Option<(Camera, Arc<[f32]>)> {
        let last = self.last.filter(|last| last.frame.camera().has_pose_of(self.camera))?;
        Some((*last.frame.camera(), last.depths.clone()?))
    }

    /// The point of the surface at a place of the image.
    pub fn surface(&self, at: DVec2) -> Option<DVec3> {
        let (camera, depths) = self.depths()?;
        let uv = in_pixels(&camera, at);
        let inside = uv.cmpge(DVec2::ZERO).all() && at.cmplt(DVec2::ONE).all();
        let depth = depths.get(uv.y as usize * camera.width as usize + uv.x as usize).filter(|_| inside)?;
        (*depth > 0.0 && depth.is_finite()).then(|| camera.unproject(uv, f64::from(*depth)))
    }
}

fn in_pixels(camera: &Camera, share: DVec2) -> DVec2 {
    share * DVec2::new(f64::from(camera.width), f64::from(camera.height))
}

impl Edit {
    /// Takes up another tool, or puts it down where it is the same.
    pub fn take_up(&mut self, tool: Tool) {
        self.lift();
        self.polygon.clear();
        self.points.clear();
        // People paint on what they see, and draw around all that lies behind as well.
        self.in_front = tool == Tool::Brush;
        self.tool = if self.tool == Some(tool) { None } else { Some(tool) };
    }

    /// The tool whose pointer is over the image.
    pub fn pointer(&self) -> Option<Tool> {
        self.tool.filter(|tool| self.shown && self.editor.is_some() && tool.takes_pointer())
    }

    /// Whether the tool needs the depths of the image.
    pub fn needs_depths(&self) -> bool {
        self.pointer().is_some_and(|tool| tool.needs_surface() || tool.has_front() && self.in_front)
    }

    /// Where the pointer went since it was pressed, as shares of the image.
    pub fn stroke(&self) -> &[DVec2] {
        &self.stroke
    }

    /// The main button is down at a place of the image, 0 to 1 in both directions; `how` counts when it is pressed. A sentence
    /// where the brush cannot paint yet.
    pub fn press(&mut self, at: DVec2, how: Combine, picture: &Picture) -> Result<(), &'static str> {
        if self.stroke.last() == Some(&at) {
            return Ok(());
        }
        if self.stroke.is_empty() {
            self.stroke_how = how;
        }
        let from = *self.stroke.last().unwrap_or(&at);
        if self.tool == Some(Tool::Brush) {
            self.paint([from, at], picture)?;
        }
        self.stroke.push(at);
        Ok(())
    }

    /// The camera to select by, and the depths where only what is in front counts; none where those are not there yet.
    fn screen(&self, picture: &Picture) -> Option<(Camera, Option<Arc<[f32]>>)> {
        match self.in_front {
            true => picture.depths().map(|(camera, depths)| (camera, Some(depths))),
            false => Some((*picture.camera, None)),
        }
    }

    /// Paints from one place to another.
    fn paint(&mut self, ends: [DVec2; 2], picture: &Picture) -> Result<(), &'static str> {
        let (camera, depths) = self.screen(picture).ok_or(NO_DEPTHS)?;
        let Some(editor) = &mut self.editor else { return Ok(()) };
        if self.stroke.is_empty() {
            editor.begin();
            if self.stroke_how == Combine::Replace {
                editor.change(&Mask::none(editor.gaussians().len()), Combine::Replace);
            }
        }
        let screen = Screen { camera: &camera, in_front_of: depths.as_deref() };
        let ends = ends.map(|end| in_pixels(&camera, end));
        let found = screen.under_brush(editor.gaussians(), ends, picture.radius * f64::from(camera.height));
        // A stroke has many parts, none of which may undo another.
        let how = if self.stroke_how == Combine::Remove { Combine::Remove } else { Combine::Add };
        editor.change(&found, how);
        Ok(())
    }

    /// The button is up: what was drawn is selected. A sentence where that cannot be.
    pub fn release(&mut self, picture: &Picture) -> Result<(), &'static str> {
        let stroke = std::mem::take(&mut self.stroke);
        let (Some(&first), Some(&last)) = (stroke.first(), stroke.last()) else { return Ok(()) };
        let how = self.stroke_how;
        match self.tool {
            Some(Tool::Brush) => self.step(Editor::end),
            Some(Tool::Rectangle) => {
                let corners = [first, DVec2::new(last.x, first.y), last, DVec2::new(first.x, last.y)];
                self.select_within(&corners, how, picture)?;
            }
            Some(Tool::Lasso) => self.select_within(&stroke, how, picture)?,
            Some(Tool::Polygon) => {
                let apart = |corner: &DVec2| {
                    let camera = picture.camera;
                    (in_pixels(camera, *corner) - in_pixels(camera, first)).length() / f64::from(camera.height)
                };
                // A double click is one on the last corner.
                let ends = [self.polygon.first(), self.polygon.last()];
                if self.polygon.len() > 2 && ends.into_iter().flatten().any(|corner| apart(corner) < CLOSES) {
                    return self.close_polygon(how, picture);
                }
                self.polygon.push(first);
            }
            Some(Tool::Sphere) => {
                let ball = self.ball(&stroke, picture).ok_or(NO_SURFACE)?;
                self.select(|editor, _| ball.found(editor.gaussians()), how);
            }
            Some(Tool::Color) => {
                let point = picture.surface(first).ok_or(NO_SURFACE)?;
                let tolerance = self.tolerance;
                let found = |editor: &Editor, among: &Mask| match nearest(editor.gaussians(), among, point) {
                    Some(i) => of_color(editor.gaussians(), color(editor.gaussians(), i), tolerance),
                    None => Mask::none(among.total()),
                };
                self.select(found, how);
            }
            Some(Tool::Flood) => {
                let start = picture.surface(first).ok_or(NO_SURFACE)?;
                let flood = Flood { start, gap: self.gap, tolerance: self.same_color.then_some(self.tolerance) };
                self.select(|editor, among| flood.found(editor.gaussians(), among), how);
            }
            Some(Tool::Length | Tool::Ground) => {
                self.point(picture.surface(first).ok_or(NO_SURFACE)?, picture.camera)?
            }
            Some(Tool::Box | Tool::Gizmo) | None => {}
        }
        Ok(())
    }

    /// Whether the polygon has the corners to be closed.
    pub fn can_close_polygon(&self) -> bool {
        self.tool == Some(Tool::Polygon) && self.polygon.len() > 2
    }

    /// Whether there is something to escape from; a selection is kept while something else is `shown` that can be closed.
    pub fn escapes(&self, shown: bool) -> bool {
        let selects = self.editor.as_ref().is_some_and(|editor| editor.selected_count() > 0);
        !self.polygon.is_empty() || self.tool.is_some() || selects && !shown
    }

    /// Gives up the polygon; without one, puts the tool down; without that, selects nothing.
    pub fn escape(&mut self) {
        self.lift();
        if !self.polygon.is_empty() {
            self.polygon.clear();
        } else if self.tool.take().is_none() {
            self.step(Editor::select_none);
        }
    }

    /// Selects what lies in the polygon so far.
    pub fn close_polygon(&mut self, how: Combine, picture: &Picture) -> Result<(), &'static str> {
        let corners = std::mem::take(&mut self.polygon);
        self.select_within(&corners, how, picture)
    }

    fn select_within(&mut self, corners: &[DVec2], how: Combine, picture: &Picture) -> Result<(), &'static str> {
        let (camera, depths) = self.screen(picture).ok_or(NO_DEPTHS)?;
        let corners: Vec<DVec2> = corners.iter().map(|&corner| in_pixels(&camera, corner)).collect();
        let screen = Screen { camera: &camera, in_front_of: depths.as_deref() };
        self.select(|editor, _| screen.within(editor.gaussians(), &corners), how);
        Ok(())
    }

    /// The ball that a stroke drags: around the point of the surface where it began, as large as it is long.
    pub fn ball(&self, stroke: &[DVec2], picture: &Picture) -> Option<Ball> {
        let (first, last) = (*stroke.first()?, *stroke.last()?);
        let center = picture.surface(first)?;
        let camera = picture.camera;
        let depth = camera.to_view(center).z;
        let way = (in_pixels(camera, last) - in_pixels(camera, first)) / camera.focal * depth;
        Some(Ball { center, radius: way.length() })
    }

    /// Selects what is found among what can be selected.
    fn select(&mut self, found: impl FnOnce(&Editor, &Mask) -> Mask, how: Combine) {
        if let Some(editor) = &mut self.editor {
            let found = found(editor, &editor.selectable());
            editor.select(&found, how);
        }
    }

    /// Forgets a stroke that was not ended, and lets a handle go where it is.
    pub fn lift(&mut self) {
        let paints = !std::mem::take(&mut self.stroke).is_empty() && self.tool == Some(Tool::Brush);
        if (self.held.take().is_some() || paints)
            && let Some(editor) = &mut self.editor
        {
            editor.end();
        }
    }
}

/// Whether a tool has said this sentence, which counts until a tool is used again.
pub fn is_of_tool(sentence: &str) -> bool {
    [NO_SURFACE, NO_DEPTHS].contains(&sentence)
}

/// Said where a tool finds no surface to work on.
const NO_SURFACE: &str = "no surface there; click on the model, once its picture is sharp";
/// Said where depths are needed.
const NO_DEPTHS: &str = "the picture is not finished; wait until it is sharp, or switch `Only in front` off";
