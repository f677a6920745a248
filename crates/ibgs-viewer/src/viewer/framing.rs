//! Where to look, and where the image goes.

use crate::canvas::SIDES;
use eframe::egui::emath::GuiRounding;
use eframe::egui::{Rect, Vec2};
use glam::{DVec2, DVec3};
use ibgs_core::camera::{Camera, usable_extent};
use ibgs_core::median;

/// Share of the points that may lie below the ground.
const OUTLIERS: f64 = 0.02;

/// The largest part of a room with this ratio of width and height, in its middle and of whole pixels, so that a picture of that
/// size stays sharp.
pub fn fitted(room: Rect, ratio: f32, pixels_per_point: f32) -> Rect {
    let size = match room.width() / room.height().max(1.0) > ratio {
        true => Vec2::new(room.height() * ratio, room.height()),
        false => Vec2::new(room.width(), room.width() / ratio),
    };
    let size = size.round_to_pixels(pixels_per_point);
    Rect::from_min_size((room.center() - size / 2.0).round_to_pixels(pixels_per_point), size)
}

/// A camera with the largest image that fits into a room.
pub fn inscribed(camera: &Camera, [width, height]: [u32; 2]) -> Camera {
    let (w, h) = (f64::from(camera.width), f64::from(camera.height));
    let scale = (f64::from(width) / w).min(f64::from(height) / h);
    let side = |length: f64| ((length * scale).round() as u32).max(SIDES[0]);
    camera.resized(side(w), side(h))
}

/// A camera that sees more around the image of another one, which lies in the middle.
pub fn widened(camera: &Camera, [width, height]: [u32; 2]) -> Camera {
    let sides = |width: u32, height: u32| DVec2::new(width.into(), height.into());
    let more = sides(width, height) - sides(camera.width, camera.height);
    Camera { width, height, principal: camera.principal + more / 2.0, ..*camera }
}

/// Median place of some points, and their median distance from it.
pub fn middle(points: impl Iterator<Item = DVec3> + Clone) -> (DVec3, f64) {
    let middle = |values: &mut dyn Iterator<Item = f64>| {
        median(values.filter(|value| value.is_finite()).collect()).unwrap_or_default()
    };
    let axis = |of: fn(DVec3) -> f64| middle(&mut points.clone().map(of));
    let center = DVec3::new(axis(|p| p.x), axis(|p| p.y), axis(|p| p.z));
    let extent = middle(&mut points.map(|point| point.distance(center)));
    (center, usable_extent(extent))
}

/// The point below or above `center` at the height where the lowest points lie, a few outliers aside; none without points.
pub fn lowest(points: impl Iterator<Item = DVec3>, up: DVec3, center: DVec3) -> Option<DVec3> {
    let mut heights: Vec<f64> = points.map(|point| (point - center).dot(up)).filter(|z| z.is_finite()).collect();
    heights.sort_by(f64::total_cmp);
    let height = heights.get((heights.len() as f64 * OUTLIERS) as usize)?;
    Some(center + up * *height)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::navigator::Navigator;
    use eframe::egui::Pos2;

    #[test]
    fn images_fit_into_any_room() {
        let room = Rect::from_min_size(Pos2::new(10.0, 20.0), Vec2::new(200.0, 100.0));
        for (ratio, pixels) in [(0.1, 1.0), (1.0, 1.0), (1.337, 1.0), (1.337, 1.5), (2.0, 2.0), (5.0, 1.0)] {
            let image = fitted(room, ratio, pixels);
            assert!(room.expand(0.51).contains_rect(image) && (image.center() - room.center()).length() < 0.8);
            assert!((image.width() / image.height() - ratio).abs() < 0.02 * ratio, "{image:?}");
            assert!((image.width() - 200.0).abs() < 0.51 || (image.height() - 100.0).abs() < 0.51);
            let corners = [image.left(), image.top(), image.right(), image.bottom()].map(|place| place * pixels);
            assert!(corners.iter().all(|place| (place - place.round()).abs() < 1e-3), "{corners:?}");
        }
    }

    #[test]
    fn the_ground_is_where_most_points_end() {
        let up = DVec3::NEG_Y;
        let points = (0..1000).map(|i| DVec3::new(f64::from(i), -f64::from(i % 100) / 10.0, 5.0));
        let outliers = [DVec3::new(0.0, 500.0, 0.0), DVec3::NAN];
        let ground = lowest(points.chain(outliers), up, DVec3::new(7.0, -3.0, 1.0)).unwrap();
        assert!(ground.abs_diff_eq(DVec3::new(7.0, -0.1, 1.0), 0.11), "{ground}");
        assert_eq!(lowest(std::iter::empty(), up, DVec3::ZERO), None);
    }

    #[test]
    fn leaving_a_view_keeps_the_size_of_all_that_is_seen() {
        for [width, height] in [[40, 30], [30, 40], [32, 32]] {
            let view = Navigator::facing(DVec3::ZERO, 3.0).camera(width, height);
            let left = Navigator::at(&view, DVec3::ZERO, DVec3::NEG_Y);
            for room in [[390, 620], [620, 390], [1200, 300], [300, 1200], [400, 300]] {
                let (on, off) = (widened(&inscribed(&view, room), room), left.camera(room[0], room[1]));
                assert_eq!([on.width, on.height], [off.width, off.height]);
                let ratio = off.focal / on.focal;
                assert!(ratio.abs_diff_eq(DVec2::ONE, 0.01), "{width} x {height} in {room:?}: {ratio}");
            }
        }
    }

    #[test]
    fn a_wider_camera_sees_the_same_in_its_middle() {
        let camera = Navigator::facing(DVec3::ZERO, 3.0).camera(40, 30);
        let wide = widened(&camera, [100, 40]);
        let point = DVec3::new(0.2, -0.1, 0.4);
        let place = |camera: &Camera| camera.project(point).0;
        assert!(place(&wide).abs_diff_eq(place(&camera) + DVec2::new(30.0, 5.0), 1e-9));
        assert_eq!((wide.width, wide.height, widened(&camera, [40, 30])), (100, 40, camera));
    }
}
