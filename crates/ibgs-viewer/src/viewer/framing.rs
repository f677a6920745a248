//! Where to look, and where the image goes.

use eframe::egui::{Rect, Vec2};
use glam::DVec3;
use ibgs_core::camera::usable_extent;

/// The largest part of a room with this ratio of width and height, in its middle.
pub fn fitted(room: Rect, ratio: f32) -> Rect {
    let size = match room.width() / room.height().max(1.0) > ratio {
        true => Vec2::new(room.height() * ratio, room.height()),
        false => Vec2::new(room.width(), room.width() / ratio),
    };
    Rect::from_center_size(room.center(), size)
}

/// Median place of some points, and their median distance from it.
pub fn middle(points: impl Iterator<Item = DVec3> + Clone) -> (DVec3, f64) {
    let median = |values: &mut dyn Iterator<Item = f64>| {
        let mut values: Vec<f64> = values.filter(|value| value.is_finite()).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or_default()
    };
    let axis = |of: fn(DVec3) -> f64| median(&mut points.clone().map(of));
    let center = DVec3::new(axis(|p| p.x), axis(|p| p.y), axis(|p| p.z));
    let extent = median(&mut points.map(|point| point.distance(center)));
    (center, usable_extent(extent))
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::Pos2;

    #[test]
    fn images_fit_into_any_room() {
        let room = Rect::from_min_size(Pos2::new(10.0, 20.0), Vec2::new(200.0, 100.0));
        for ratio in [0.1, 1.0, 2.0, 5.0] {
            let image = fitted(room, ratio);
            assert!(room.expand(0.01).contains_rect(image) && image.center() == room.center());
            assert!((image.width() / image.height() - ratio).abs() < 1e-3);
            assert!((image.width() - 200.0).abs() < 1e-3 || (image.height() - 100.0).abs() < 1e-3);
        }
    }
}
