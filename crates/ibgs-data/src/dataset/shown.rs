//! Which points of a cloud a camera shows, judged by the cloud alone.

use crate::camera::Camera;
use glam::DVec3;

/// Cells along the longer side of an image.
const CELLS: f64 = 32.0;
/// A point that lies farther away than the nearest one of its cell, by this factor, is hidden.
const HIDDEN: f64 = 1.25;

/// The points that a camera shows, each with its cell of a coarse grid over the image: those in the image and in front of it
/// that are not much farther away than the nearest point in their cell.
pub fn shown(camera: &Camera, points: &[DVec3]) -> Vec<(u32, u32)> {
    let size = [camera.width, camera.height].map(f64::from);
    let side = size[0].max(size[1]) / CELLS;
    let [columns, rows] = size.map(|length| (length / side).ceil().max(1.0) as u32);
    let mut nearest = vec![f64::INFINITY; columns as usize * rows as usize];
    let mut inside = Vec::new();
    for (index, &point) in points.iter().enumerate() {
        if let Some((at, depth)) = camera.seen(point) {
            let [x, y] = [at.x, at.y].map(|length| (length / side) as u32);
            let cell = y.min(rows - 1) * columns + x.min(columns - 1);
            let first = &mut nearest[cell as usize];
            *first = first.min(depth);
            inside.push((cell, index as u32, depth));
        }
    }
    let visible = inside.into_iter().filter(|(cell, _, depth)| *depth <= HIDDEN * nearest[*cell as usize]);
    visible.map(|(cell, index, _)| (cell, index)).collect()
}

/// The median depth of the points that a camera shows; none where it shows none.
pub fn median_depth(camera: &Camera, points: &[DVec3]) -> Option<f64> {
    crate::median(points.iter().filter_map(|point| Some(camera.seen(*point)?.1)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec2};

    #[test]
    fn what_is_outside_behind_or_hidden_is_not_shown() {
        let camera = Camera {
            width: 64,
            height: 32,
            focal: DVec2::splat(32.0),
            principal: DVec2::new(32.0, 16.0),
            view_from_world: DMat3::IDENTITY,
            translation: DVec3::ZERO,
        };
        let points = [
            DVec3::new(0.0, 0.0, 1.0),
            DVec3::new(0.0, 0.0, 1.2),
            DVec3::new(0.0, 0.0, 1.3),
            DVec3::new(0.0, 0.0, -1.0),
            DVec3::new(2.0, 0.0, 1.0),
            DVec3::new(0.0, -0.6, 1.0),
            DVec3::new(-0.9, 0.4, 1.0),
            DVec3::splat(f64::NAN),
        ];
        let found = shown(&camera, &points);
        assert_eq!(found.iter().map(|(_, index)| *index).collect::<Vec<_>>(), [0, 1, 6]);
        assert_eq!(found[0].0, found[1].0);
        assert_eq!(found[0].0, 8 * 32 + 16);
    }
}
