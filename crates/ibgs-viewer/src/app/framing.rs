//! Where to look, and where the image goes.

use eframe::egui::{Rect, Vec2};
use glam::DVec3;
use ibgs_core::camera::{Camera, usable_extent};

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

/// The point nearest to all optical axes: what a capture looks at.
pub fn looked_at<'a>(cameras: impl Iterator<Item = &'a Camera> + Clone) -> Option<DVec3> {
    // Sum of (I - f f^T) (p - c) = 0 over the cameras.
    let mut matrix = glam::DMat3::ZERO;
    let mut right = DVec3::ZERO;
    for camera in cameras.clone() {
        let f = camera.forward();
        let across = glam::DMat3::IDENTITY - glam::DMat3::from_cols(f * f.x, f * f.y, f * f.z);
        matrix += across;
        right += across * camera.center();
    }
    let count = cameras.clone().count() as f64;
    // Nearly parallel axes meet nowhere.
    if count < 2.0 || matrix.determinant() < 1e-3 * count.powi(3) {
        return None;
    }
    let point = matrix.inverse() * right;
    let ahead = cameras.filter(|camera| camera.to_view(point).z > 0.0).count() as f64;
    (point.is_finite() && ahead > 0.5 * count).then_some(point)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::navigator::Navigator;
    use eframe::egui::Pos2;

    #[test]
    fn a_ring_of_cameras_looks_at_its_middle() {
        let target = DVec3::new(1.0, -2.0, 0.5);
        let ring: Vec<Camera> = (0..8)
            .map(|i| {
                let mut navigator = Navigator::facing(target, 3.0);
                navigator.orbit(f64::from(i) * 0.7, 0.3);
                navigator.camera(64, 48)
            })
            .collect();
        assert!(looked_at(ring.iter()).unwrap().abs_diff_eq(target, 1e-9));
        // Cameras that face forward side by side meet nowhere; neither does one alone.
        let row: Vec<Camera> =
            (0..4).map(|i| Navigator::facing(DVec3::new(f64::from(i), 0.0, 0.0), 3.0).camera(64, 48)).collect();
        assert_eq!(looked_at(row.iter()), None);
        assert_eq!(looked_at(ring[..1].iter()), None);
    }

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
