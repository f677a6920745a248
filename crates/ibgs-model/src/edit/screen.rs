//! Ways to select Gaussians on a picture: a brush, an outline, and what lies nearest to a place of the scene.

use super::{Mask, place};
use crate::camera::Camera;
use crate::scene::Gaussians;
use glam::{DVec2, DVec3};

/// Part of the median depth by which the centre of a Gaussian of the surface may lie behind it.
const BEHIND: f64 = 0.02;

/// A picture on which Gaussians are selected by their centres.
#[derive(Clone, Copy, Debug)]
pub struct Screen<'a> {
    /// Its camera, in the scene's coordinates.
    pub camera: &'a Camera,
    /// Median depths of the picture in scene units, of the camera's size: what lies behind them is not found.
    pub in_front_of: Option<&'a [f32]>,
}

impl Screen<'_> {
    /// Where a point is seen, in pixels; none behind the camera and behind the surface.
    fn seen(&self, point: DVec3) -> Option<DVec2> {
        let (at, z) = self.camera.project(point);
        (z > 0.0 && self.is_in_front(at, z)).then_some(at)
    }

    fn is_in_front(&self, at: DVec2, z: f64) -> bool {
        let Some(depths) = self.in_front_of else { return true };
        let (width, height) = (f64::from(self.camera.width), f64::from(self.camera.height));
        // Beyond the edge nothing is known to be in front.
        if at.x < 0.0 || at.y < 0.0 || at.x >= width || at.y >= height {
            return false;
        }
        let surface = depths.get(at.y as usize * self.camera.width as usize + at.x as usize);
        // 0: the light meets no surface, so nothing hides.
        surface.is_some_and(|&surface| surface <= 0.0 || z <= f64::from(surface) * (1.0 + BEHIND))
    }

    /// The Gaussians whose centres a disc passes over. It goes from one place to another; all in pixels.
    pub fn under_brush(&self, gaussians: &Gaussians, [from, to]: [DVec2; 2], radius: f64) -> Mask {
        let way = to - from;
        let length = way.length_squared();
        Mask::of(gaussians.len(), |i| {
            self.seen(place(gaussians, i)).is_some_and(|at| {
                let along = if length > 0.0 { ((at - from).dot(way) / length).clamp(0.0, 1.0) } else { 0.0 };
                at.distance_squared(from + way * along) <= radius * radius
            })
        })
    }

    /// The Gaussians whose centres lie within an outline, given by its corners in pixels. It is closed; where it crosses itself
    /// the even-odd rule holds.
    pub fn within(&self, gaussians: &Gaussians, corners: &[DVec2]) -> Mask {
        let low = corners.iter().copied().reduce(DVec2::min).unwrap_or_default();
        let high = corners.iter().copied().reduce(DVec2::max).unwrap_or_default();
        Mask::of(gaussians.len(), |i| {
            self.seen(place(gaussians, i))
                .is_some_and(|at| at.cmpge(low).all() && at.cmple(high).all() && is_within(at, corners))
        })
    }
}

/// Even-odd rule: a ray to the right crosses an odd number of sides.
fn is_within(at: DVec2, corners: &[DVec2]) -> bool {
    let sides = corners.iter().zip(corners.iter().cycle().skip(1));
    let crossed =
        sides.filter(|(a, b)| (a.y > at.y) != (b.y > at.y) && at.x < a.x + (at.y - a.y) / (b.y - a.y) * (b.x - a.x));
    crossed.count() % 2 == 1
}

/// The Gaussian of a mask whose centre is nearest to a point of the scene.
pub fn nearest(gaussians: &Gaussians, among: &Mask, point: DVec3) -> Option<usize> {
    let distance = |i: &usize| place(gaussians, *i).distance_squared(point);
    among.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

#[cfg(test)]
mod tests {
    use super::super::tests::{camera, grid};
    use super::*;

    #[test]
    fn a_brush_finds_what_it_passes_over() {
        let (gaussians, camera) = (grid(), camera());
        let middle = DVec2::new(50.0, 40.0);
        let screen = Screen { camera: &camera, in_front_of: None };
        assert_eq!(screen.under_brush(&gaussians, [middle; 2], 1.0).count(), 7, "the points of the optical axis");
        // Along x at the depth of the origin points are 10 pixels apart.
        let found = screen.under_brush(&gaussians, [middle, middle + DVec2::new(20.0, 0.0)], 1.0);
        assert!(found.iter().all(|i| place(&gaussians, i).y == 0.0 && place(&gaussians, i).x >= 0.0));
        assert_eq!(found.iter().filter(|&i| place(&gaussians, i).z == 0.0).count(), 3);
        // The surface lies at the depth of z = -1: the points before it are those at -3, -2 and -1.
        let mut depths = vec![9.0; 8000];
        let seen = Screen { in_front_of: Some(&depths), ..screen };
        assert_eq!(seen.under_brush(&gaussians, [middle; 2], 1.0).count(), 3);
        depths[40 * 100 + 50] = 0.0;
        let open = Screen { in_front_of: Some(&depths), ..screen };
        assert_eq!(open.under_brush(&gaussians, [middle; 2], 1.0).count(), 7, "where nothing is met nothing hides");
        // Behind the camera there is nothing to see.
        let behind = Camera { translation: DVec3::new(0.0, 0.0, -10.0), ..camera };
        assert_eq!(Screen { camera: &behind, ..screen }.under_brush(&gaussians, [middle; 2], 1e9).count(), 0);
    }

    #[test]
    fn an_outline_finds_what_lies_within() {
        let (gaussians, camera) = (grid(), camera());
        let screen = Screen { camera: &camera, in_front_of: None };
        let at = |x: f64, y: f64| DVec2::new(50.0 + x, 40.0 + y);
        let box_of = |half: f64| [at(-half, -half), at(half, -half), at(half, half), at(-half, half)];
        // A centre at depth d lies 100 / d pixels from its neighbour; none lies on these boxes' sides.
        let inside = |half: f64| {
            let seen = |i: &usize| {
                let place = place(&gaussians, *i);
                (100.0 * place.truncate() / (place.z + 10.0)).abs().max_element() < half
            };
            (0..gaussians.len()).filter(seen).count()
        };
        for half in [1.0, 8.0, 26.0, 1000.0] {
            assert_eq!(screen.within(&gaussians, &box_of(half)).count(), inside(half), "{half}");
        }
        // Half of the box without its corner, either way round.
        let corner = [at(-26.0, -26.0), at(26.0, -26.0), at(-26.0, 26.0)];
        let found = screen.within(&gaussians, &corner);
        let turned = screen.within(&gaussians, &[corner[2], corner[1], corner[0]]);
        assert!(found == turned && found.count() > 0 && found.count() < inside(26.0));
        assert!(found.iter().all(|i| place(&gaussians, i).x + place(&gaussians, i).y <= 0.0));
        // A frame with a hole: the inner box is walked through a second time.
        let ring = [&box_of(26.0)[..], &[at(-26.0, -26.0)], &box_of(8.0), &[at(-8.0, -8.0)]].concat();
        assert_eq!(screen.within(&gaussians, &ring).count(), inside(26.0) - inside(8.0));
        for none in [&[][..], &[at(0.0, 0.0)], &[at(0.0, 0.0), at(9.0, 0.0)]] {
            assert_eq!(screen.within(&gaussians, none).count(), 0);
        }
        // Only what is in front of a surface at z = -1.
        let depths = vec![9.0; 8000];
        let seen = Screen { in_front_of: Some(&depths), ..screen };
        let front = seen.within(&gaussians, &box_of(8.0));
        assert!(front.iter().all(|i| place(&gaussians, i).z <= -1.0) && front.count() > 0);
    }

    #[test]
    fn the_nearest_centre_is_found_among_those_that_count() {
        let gaussians = grid();
        let all = Mask::all(gaussians.len());
        let at = nearest(&gaussians, &all, DVec3::new(1.2, -0.9, 2.9)).unwrap();
        assert!(place(&gaussians, at).abs_diff_eq(DVec3::new(1.0, -1.0, 3.0), 1e-6));
        let others = all.without(&Mask::of(gaussians.len(), |i| i == at));
        let next = nearest(&gaussians, &others, DVec3::new(1.2, -0.9, 2.9)).unwrap();
        assert!(place(&gaussians, next).abs_diff_eq(DVec3::new(2.0, -1.0, 3.0), 1e-6));
        assert_eq!(nearest(&gaussians, &Mask::none(gaussians.len()), DVec3::ZERO), None);
    }
}
