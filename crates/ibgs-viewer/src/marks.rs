//! What is drawn over the image: the scene's cameras, its sparse points, and the pixel that was asked about.

use crate::viewer::Viewer;
use eframe::egui::{Color32, Mesh, Painter, Pos2, Rect, Shape, Stroke, Vec2};
use glam::{DVec2, DVec3};
use ibgs_core::camera::Camera;

/// Length of a drawn camera over the scene's extent.
const LENGTH: f64 = 0.06;
/// Most points that are drawn.
const MOST_POINTS: usize = 20_000;
/// Lines of a grid on each side of its middle.
const GRID: f64 = 10.0;
/// Things nearer than this share of the extent are not drawn.
const NEAR: f64 = 1e-3;

/// Colour of a training view, of a held-out one, and of one that a pixel reads from.
pub const TRAINED: Color32 = Color32::from_rgb(90, 150, 255);
pub const HELD_OUT: Color32 = Color32::from_rgb(255, 170, 60);
pub const SOURCE: Color32 = Color32::from_rgb(80, 230, 120);

/// Where the camera's image lies on the screen.
pub struct Onto<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// Its image.
    pub image: Rect,
    /// What is nearer is not drawn.
    pub near: f64,
}

impl<'a> Onto<'a> {
    /// The image of a scene of this extent.
    pub fn new(camera: &'a Camera, image: Rect, extent: f64) -> Self {
        Self { camera, image, near: NEAR * extent }
    }

    fn place(&self, view: DVec3) -> Pos2 {
        let uv = DVec2::new(view.x, view.y) / view.z * self.camera.focal + self.camera.principal;
        let share = uv / DVec2::new(f64::from(self.camera.width), f64::from(self.camera.height));
        self.image.min + Vec2::new(share.x as f32, share.y as f32) * self.image.size()
    }

    /// Where a point of the scene is seen.
    pub fn point(&self, world: DVec3) -> Option<Pos2> {
        let view = self.camera.to_view(world);
        (view.z > self.near).then(|| self.place(view))
    }

    /// Draws a line of the scene.
    pub fn line(&self, painter: &Painter, ends: [DVec3; 2], stroke: Stroke) {
        let [mut a, mut b] = ends.map(|world| self.camera.to_view(world));
        if a.z > b.z {
            std::mem::swap(&mut a, &mut b);
        }
        if b.z <= self.near {
            return;
        }
        if a.z < self.near {
            a = a.lerp(b, (self.near - a.z) / (b.z - a.z));
        }
        painter.line_segment([self.place(a), self.place(b)], stroke);
    }

    fn frustum(&self, painter: &Painter, of: &Camera, length: f64, stroke: Stroke) {
        let tip = of.center();
        let (w, h) = (f64::from(of.width), f64::from(of.height));
        let corner = |x: f64, y: f64| {
            let ray = ((DVec2::new(x, y) - of.principal) / of.focal).extend(1.0);
            tip + of.view_from_world.transpose() * (ray * length)
        };
        let corners = [corner(0.0, 0.0), corner(w, 0.0), corner(w, h), corner(0.0, h)];
        for i in 0..4 {
            self.line(painter, [tip, corners[i]], stroke);
            self.line(painter, [corners[i], corners[(i + 1) % 4]], stroke);
        }
        // Up is where the short line is.
        let up = (corners[0] + corners[1]) * 0.5;
        self.line(painter, [up, up + (corners[0] - corners[3]) * 0.25], stroke);
    }
}

/// Distance of the lines of a grid that suits a length of the scene.
pub fn grid_unit(length: f64) -> f64 {
    10_f64.powf(length.log10().floor())
}

/// A grid of lines that are `unit` apart, where `at` has the place of its two coordinates in the scene.
pub fn grid(painter: &Painter, onto: &Onto, unit: f64, at: impl Fn(f64, f64) -> DVec3) {
    let half = GRID * unit;
    for step in -(GRID as i32)..=GRID as i32 {
        let along = f64::from(step) * unit;
        let line = Stroke::new(1.0, Color32::from_white_alpha(70));
        onto.line(painter, [at(along, -half), at(along, half)], line);
        onto.line(painter, [at(-half, along), at(half, along)], line);
    }
}

/// The grid on the ground of the scene, where the editor does not draw that of the file.
fn ground(viewer: &Viewer, painter: &Painter, onto: &Onto) {
    let Some(middle) = viewer.ground.filter(|_| viewer.settings.shows_ground && !viewer.edit.shows_ground()) else {
        return;
    };
    let (x, z) = viewer.navigator.up.any_orthonormal_pair();
    grid(painter, onto, grid_unit(viewer.extent), |along, across| middle + x * along + z * across);
}

/// Draws what is to be seen over the image.
pub fn draw(viewer: &Viewer, painter: &Painter, onto: &Onto) {
    let Some(scene) = &viewer.scene else { return };
    ground(viewer, painter, onto);
    if viewer.panels.shows_points {
        let mut mesh = Mesh::default();
        let step = scene.points.len().div_ceil(MOST_POINTS).max(1);
        for point in scene.points.iter().step_by(step) {
            if let Some(at) = onto.point(point.position).filter(|at| onto.image.contains(*at)) {
                let [r, g, b] = point.color;
                mesh.add_colored_rect(Rect::from_center_size(at, Vec2::splat(2.0)), Color32::from_rgb(r, g, b));
            }
        }
        painter.add(Shape::mesh(mesh));
    }
    let sources: Vec<usize> = viewer.found.iter().flat_map(|found| found.views.iter().flatten().copied()).collect();
    for (index, view) in scene.views.iter().enumerate() {
        let is_source = sources.contains(&index);
        if (viewer.panels.shows_cameras || is_source) && viewer.on_view != Some(index) {
            let color = match (is_source, view.held_out) {
                (true, _) => SOURCE,
                (false, true) => HELD_OUT,
                (false, false) => TRAINED,
            };
            let stroke = Stroke::new(if is_source { 2.0 } else { 1.0 }, color);
            onto.frustum(painter, &view.camera, LENGTH * viewer.extent, stroke);
        }
    }
    if let Some(point) = viewer.found.as_ref().and_then(|found| found.inspection.point)
        && let Some(at) = onto.point(point)
    {
        cross(painter, at);
    }
}

/// A cross with a dark rim, seen on any colour.
pub fn cross(painter: &Painter, at: Pos2) {
    for (width, color) in [(4.0, Color32::from_black_alpha(160)), (1.5, SOURCE)] {
        for way in [Vec2::new(7.0, 0.0), Vec2::new(0.0, 7.0)] {
            painter.line_segment([at - way, at + way], Stroke::new(width, color));
        }
    }
}
