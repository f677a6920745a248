//! The free space around the training cameras. Who took a photo stood there, so nothing is near him that the photo's points do
//! not show; a Gaussian there is fog that hides the scene from views beside that photo.

use glam::{DVec3, Vec3};
use ibgs_core::camera::Camera;
use ibgs_core::dataset::{Point, median_depth};
use ibgs_core::local_space::LocalSpace;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Points that are looked at; of more, every n-th.
const LOOKED_AT: usize = 20_000;
/// So many points may lie in the free space around a camera at most, and one of a thousand: matching errs.
const ASTRAY: usize = 3;

/// Balls around the training cameras in which no Gaussian stays, in local coordinates.
#[derive(Clone, Debug)]
pub struct FreeSpace {
    /// Centres and squared radii of those that reach into each cube of a grid.
    balls: BTreeMap<[i32; 3], Vec<(Vec3, f32)>>,
    /// Side of a cube.
    side: f32,
}

/// No free space.
pub static NOWHERE: FreeSpace = FreeSpace { balls: BTreeMap::new(), side: 1.0 };

impl FreeSpace {
    /// Radius of each ball: `part` of the median depth of those `points` that lie within the camera's image, less where points
    /// are nearer than that. The cameras are in the coordinates of `space`, the points in the scene's.
    pub fn new(cameras: &[Camera], (points, space): (&[Point], &LocalSpace), part: f64) -> Self {
        if part <= 0.0 {
            return NOWHERE.clone();
        }
        let step = points.len().div_ceil(LOOKED_AT).max(1);
        let points: Vec<DVec3> = points.iter().step_by(step).map(|point| space.to_local(point.position)).collect();
        let found: Vec<(Vec3, f32)> = cameras
            .par_iter()
            .filter_map(|camera| Some((camera.center().as_vec3(), radius(camera, &points, part)? as f32)))
            .collect();
        // A ball then reaches into eight cubes at most.
        let side = found.iter().fold(f32::MIN_POSITIVE, |side, &(_, radius)| side.max(2.0 * radius));
        let mut balls: BTreeMap<[i32; 3], Vec<(Vec3, f32)>> = BTreeMap::new();
        for (centre, radius) in found {
            let [low, high] = [centre - radius, centre + radius].map(|corner| cube(corner, side));
            for x in low[0]..=high[0] {
                for y in low[1]..=high[1] {
                    for z in low[2]..=high[2] {
                        balls.entry([x, y, z]).or_default().push((centre, radius * radius));
                    }
                }
            }
        }
        Self { balls, side }
    }

    /// Which of the places lie in it.
    pub fn contains(&self, places: &[[f32; 3]]) -> Vec<bool> {
        let inside = |place: &[f32; 3]| {
            let place = Vec3::from(*place);
            let near = self.balls.get(&cube(place, self.side));
            near.is_some_and(|balls| balls.iter().any(|&(centre, square)| place.distance_squared(centre) < square))
        };
        places.par_iter().map(inside).collect()
    }
}

fn cube(place: Vec3, side: f32) -> [i32; 3] {
    (place / side).floor().as_ivec3().to_array()
}

/// None where the camera sees no point.
fn radius(camera: &Camera, points: &[DVec3], part: f64) -> Option<f64> {
    let median = median_depth(camera, points)?;
    let mut squares: Vec<f64> = points.iter().map(|point| point.distance_squared(camera.center())).collect();
    let astray = ASTRAY.max(points.len() / 1_000).min(points.len() - 1);
    let nearest = squares.select_nth_unstable_by(astray, f64::total_cmp).1.sqrt();
    Some(nearest.min(part * median))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec2};

    /// At the origin, looking along z.
    fn camera() -> Camera {
        Camera {
            width: 100,
            height: 80,
            focal: DVec2::splat(50.0),
            principal: DVec2::new(50.0, 40.0),
            view_from_world: DMat3::IDENTITY,
            translation: DVec3::ZERO,
        }
    }

    fn points(depths: impl Iterator<Item = f64>) -> Vec<Point> {
        depths.map(|z| Point { position: DVec3::new(0.1, 0.1, z), color: [0; 3] }).collect()
    }

    fn around(cameras: &[Camera], points: &[Point], part: f64) -> FreeSpace {
        FreeSpace::new(cameras, (points, &LocalSpace::default()), part)
    }

    #[test]
    fn a_part_of_the_median_depth_is_free() {
        // What the camera does not see does not count: behind it, beside its image.
        let mut all = points((0..101).map(|i| 2.0 + 0.06 * f64::from(i)).chain([-9.0; 200]));
        all.extend([Point { position: DVec3::new(90.0, 0.0, 3.0), color: [0; 3] }; 200]);
        let space = around(&[camera()], &all, 0.2);
        let inside = space.contains(&[[0.0, 0.0, 0.99], [0.0, -0.99, 0.0], [0.0, 0.0, 1.01], [0.8, 0.8, 0.0]]);
        assert_eq!(inside, [true, true, false, false], "the median depth is 5");
        let doubled = around(&[camera()], &all, 0.39).contains(&[[0.0, 0.0, 1.9], [0.0, 0.0, 2.0]]);
        assert_eq!(doubled, [true, false]);
    }

    #[test]
    fn points_near_the_camera_keep_their_place() {
        let few = |near: usize| points([0.3, 0.35, 0.4, 0.45].into_iter().take(near).chain([5.0; 900]));
        let place = [[0.0, 0.0, 0.5], [0.0, 0.0, 0.4]];
        let inside = |near| around(&[camera()], &few(near), 0.2).contains(&place);
        assert_eq!(inside(3), [true, true], "three may be astray");
        assert_eq!(inside(4), [false, true]);
    }

    #[test]
    fn nothing_is_free_without_points_or_where_it_is_off() {
        let all = points([5.0; 9].into_iter());
        let place = [[0.0, 0.0, 0.1]];
        for space in [
            around(&[camera()], &points([-1.0; 9].into_iter()), 0.2),
            around(&[camera()], &[], 0.2),
            around(&[], &all, 0.2),
            around(&[camera()], &all, 0.0),
        ] {
            assert_eq!(space.contains(&place), [false]);
        }
        assert_eq!(around(&[camera()], &all, 0.2).contains(&place), [true]);
    }
}
