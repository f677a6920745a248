//! Ways to select Gaussians: a box in the scene, a brush on the screen, limits of their own values.

use super::Mask;
use crate::camera::Camera;
use crate::scene::Gaussians;
use glam::{DMat3, DVec2, DVec3};

/// Part of the median depth by which the centre of a Gaussian of the surface may lie behind it.
const BEHIND: f64 = 0.02;
/// Number of a model's points to which a box around it is fitted.
const SAMPLES: usize = 20_000;
/// Least side of a box over its largest one.
const LEAST_SIDE: f64 = 1e-4;

/// A box in the scene that is turned about an up axis alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CropBox {
    /// Its middle.
    pub center: DVec3,
    /// Its sides: two across, then along the up axis.
    pub size: DVec3,
    /// The up axis, of length one.
    pub up: DVec3,
    /// Turn about it in radians.
    pub turn: f64,
}

impl CropBox {
    /// A box around `points` that leaves out the outermost fraction `outside` of them at each face; none without
    /// points.
    pub fn around(points: impl Iterator<Item = DVec3>, up: DVec3, turn: f64, outside: f64) -> Option<Self> {
        let blank = Self { center: DVec3::ZERO, size: DVec3::ZERO, up, turn };
        let axes = blank.axes();
        let points: Vec<DVec3> =
            points.map(|point| axes.transpose() * point).filter(|point| point.is_finite()).collect();
        let step = points.len().div_ceil(SAMPLES).max(1);
        let range = |axis: usize| {
            let mut values: Vec<f64> = points.iter().step_by(step).map(|point| point[axis]).collect();
            values.sort_unstable_by(f64::total_cmp);
            let last = values.len().checked_sub(1)?;
            let skipped = (outside.clamp(0.0, 0.5) * last as f64) as usize;
            Some((values[skipped], values[last - skipped]))
        };
        let [x, y, z] = [range(0)?, range(1)?, range(2)?];
        let (low, high) = (DVec3::new(x.0, y.0, z.0), DVec3::new(x.1, y.1, z.1));
        let size = high - low;
        let least = (LEAST_SIDE * size.max_element()).max(f64::MIN_POSITIVE);
        Some(Self { center: axes * (0.5 * (low + high)), size: size.max(DVec3::splat(least)), ..blank })
    }

    /// Its axes as columns: two across, then up.
    pub fn axes(&self) -> DMat3 {
        // A turn of 0 is along the world axis that is most perpendicular to the up axis.
        let least = self.up.abs().min_position();
        let across = DVec3::AXES[least];
        let first = (across - self.up * across.dot(self.up)).normalize_or(DVec3::X);
        let (sin, cos) = self.turn.sin_cos();
        let first = first * cos + self.up.cross(first) * sin;
        DMat3::from_cols(first, self.up.cross(first), self.up)
    }

    /// Whether a point lies in it.
    pub fn contains(&self, point: DVec3) -> bool {
        let inside = self.axes().transpose() * (point - self.center);
        inside.abs().cmple(0.5 * self.size).all()
    }

    /// Its corners; bit i of the number is set on the upper side of axis i.
    pub fn corners(&self) -> [DVec3; 8] {
        let axes = self.axes();
        std::array::from_fn(|corner| {
            let side = |axis: usize| if corner >> axis & 1 == 1 { 0.5 } else { -0.5 };
            self.center + axes * (self.size * DVec3::new(side(0), side(1), side(2)))
        })
    }

    /// Centre of a face, 0 to 5, and its outward direction.
    pub fn face(&self, face: usize) -> (DVec3, DVec3) {
        let (axis, sign) = (face / 2 % 3, if face.is_multiple_of(2) { -1.0 } else { 1.0 });
        let out = self.axes().col(axis) * sign;
        (self.center + out * (0.5 * self.size[axis]), out)
    }

    /// Moves a face outwards by a length; the opposite face stays where it is.
    pub fn move_face(&mut self, face: usize, by: f64) {
        let axis = face / 2 % 3;
        let (_, out) = self.face(face);
        let least = LEAST_SIDE * self.size.max_element();
        let by = by.max(least - self.size[axis]);
        self.size[axis] += by;
        self.center += out * (0.5 * by);
    }

    /// The Gaussians whose centres lie in it.
    pub fn found(&self, gaussians: &Gaussians) -> Mask {
        let (axes, half) = (self.axes().transpose(), 0.5 * self.size);
        Mask::of(gaussians.len(), |i| (axes * (place(gaussians, i) - self.center)).abs().cmple(half).all())
    }
}

/// The edges of the box, as pairs of indices into [`CropBox::corners`].
pub fn box_edges() -> impl Iterator<Item = [usize; 2]> {
    let edge = |corner: usize, axis: usize| (corner >> axis & 1 == 0).then_some([corner, corner | 1 << axis]);
    (0..8).flat_map(move |corner| (0..3).filter_map(move |axis| edge(corner, axis)))
}

/// A disc that moves over a picture, from one place to another.
#[derive(Clone, Copy, Debug)]
pub struct Brush<'a> {
    /// Camera of the picture, in the scene's coordinates.
    pub camera: &'a Camera,
    /// Where it begins and ends, in pixels.
    pub ends: [DVec2; 2],
    /// Its radius in pixels.
    pub radius: f64,
    /// Median depths of the picture in scene units, of the camera's size: what lies behind them is not found.
    pub in_front_of: Option<&'a [f32]>,
}

impl Brush<'_> {
    /// The Gaussians whose centres project into it.
    pub fn found(&self, gaussians: &Gaussians) -> Mask {
        let [from, to] = self.ends;
        let way = to - from;
        let length = way.length_squared();
        Mask::of(gaussians.len(), |i| {
            let (at, z) = self.camera.project(place(gaussians, i));
            if z <= 0.0 {
                return false;
            }
            let along = if length > 0.0 { ((at - from).dot(way) / length).clamp(0.0, 1.0) } else { 0.0 };
            at.distance_squared(from + way * along) <= self.radius * self.radius && self.is_in_front(at, z)
        })
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
}

/// Limits of the Gaussians' own values. A Gaussian is found where it meets all that are set.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Filter {
    /// The opacity is below this.
    pub opacity_below: Option<f64>,
    /// The largest standard deviation is above this, in scene units.
    pub scale_above: Option<f64>,
    /// The distance from this place is above this, in scene units.
    pub farther: Option<(DVec3, f64)>,
}

impl Filter {
    /// Whether no limit is set; then it finds nothing.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// The Gaussians that meet all limits.
    pub fn found(&self, gaussians: &Gaussians) -> Mask {
        if self.is_empty() {
            return Mask::none(gaussians.len());
        }
        let below = |i: usize, limit: f64| 1.0 / (1.0 + (-f64::from(gaussians.opacity_logits[i])).exp()) < limit;
        let above = |i: usize, limit: f64| {
            let [x, y, z] = gaussians.log_scales[i].map(f64::from);
            x.max(y).max(z).exp() * gaussians.space.scale > limit
        };
        let farther = |i: usize, (from, limit): (DVec3, f64)| place(gaussians, i).distance(from) > limit;
        Mask::of(gaussians.len(), |i| {
            self.opacity_below.is_none_or(|limit| below(i, limit))
                && self.scale_above.is_none_or(|limit| above(i, limit))
                && self.farther.is_none_or(|limit| farther(i, limit))
        })
    }
}

/// Where the centre of a Gaussian lies in the scene.
fn place(gaussians: &Gaussians, index: usize) -> DVec3 {
    gaussians.space.to_scene(DVec3::from(gaussians.means[index].map(f64::from)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::local_space::LocalSpace;

    /// A grid of points with a distance of 1 around the origin of the scene, in local units of 2 around (5, 0, 0).
    fn grid() -> Gaussians {
        let space = LocalSpace { origin: DVec3::new(5.0, 0.0, 0.0), scale: 2.0 };
        let side = || (-3..=3).map(f64::from);
        let points = side().flat_map(|x| side().flat_map(move |y| side().map(move |z| DVec3::new(x, y, z))));
        let means: Vec<[f32; 3]> = points.map(|point| space.to_local(point).as_vec3().to_array()).collect();
        let count = means.len();
        Gaussians {
            space,
            log_scales: (0..count).map(|i| [-9.0, (0.01 * (i + 1) as f32).ln(), -8.0]).collect(),
            opacity_logits: (0..count).map(|i| (i as f32 - 171.0) * 0.05).collect(),
            means,
            ..Gaussians::default()
        }
    }

    fn camera() -> Camera {
        Camera {
            width: 100,
            height: 80,
            focal: DVec2::splat(100.0),
            principal: DVec2::new(50.0, 40.0),
            view_from_world: DMat3::IDENTITY,
            translation: DVec3::new(0.0, 0.0, 10.0),
        }
    }

    #[test]
    fn a_box_finds_what_lies_in_it() {
        let gaussians = grid();
        let upright = CropBox { center: DVec3::ZERO, size: DVec3::new(2.2, 4.2, 0.2), up: DVec3::Z, turn: 0.0 };
        assert_eq!(upright.found(&gaussians).count(), 3 * 5);
        // A quarter turn changes the sides across.
        let turned = CropBox { turn: std::f64::consts::FRAC_PI_2, ..upright };
        let found = turned.found(&gaussians);
        assert_eq!(found.count(), 3 * 5);
        assert_eq!(found.and(&upright.found(&gaussians)).count(), 3 * 3);
        for up in [DVec3::NEG_Y, DVec3::X, DVec3::new(0.6, -0.8, 0.0)] {
            let tilted = CropBox { up, turn: 0.4, ..upright };
            let axes = tilted.axes();
            assert!((axes.transpose() * axes).abs_diff_eq(DMat3::IDENTITY, 1e-12) && axes.determinant() > 0.999);
            assert!(axes.z_axis.abs_diff_eq(up, 1e-12));
            let inside = |i: &usize| tilted.contains(place(&gaussians, *i));
            assert!(tilted.found(&gaussians).iter().eq((0..gaussians.len()).filter(inside)));
            assert!(tilted.corners().iter().all(|&c| tilted.contains(c.lerp(tilted.center, 1e-9))));
            assert!(tilted.corners().iter().all(|&c| !tilted.contains(c + (c - tilted.center) * 1e-9)));
        }
        assert_eq!(box_edges().count(), 12);
    }

    #[test]
    fn a_box_is_put_around_points_and_its_faces_move() {
        let gaussians = grid();
        let around = CropBox::around(gaussians.positions(), DVec3::NEG_Y, 0.3, 0.0).unwrap();
        let slack = CropBox { size: around.size * (1.0 + 1e-9), ..around };
        assert_eq!(slack.found(&gaussians).count(), gaussians.len());
        let inner = CropBox::around(gaussians.positions(), DVec3::NEG_Y, 0.0, 0.2).unwrap();
        assert!(inner.size.max_element() < 5.0 && inner.center.length() < 1e-6, "{inner:?}");
        assert_eq!(CropBox::around(std::iter::empty(), DVec3::Z, 0.0, 0.0), None);
        assert_eq!(CropBox::around([DVec3::NAN].into_iter(), DVec3::Z, 0.0, 0.0), None);
        let single = CropBox::around([DVec3::ONE].into_iter(), DVec3::Z, 0.0, 0.0).unwrap();
        assert!(single.size.min_element() > 0.0 && single.contains(DVec3::ONE));
        for face in 0..6 {
            let mut moved = around;
            let opposite = around.face(face ^ 1).0;
            moved.move_face(face, 1.5);
            assert!(moved.face(face).0.abs_diff_eq(around.face(face).0 + around.face(face).1 * 1.5, 1e-9));
            assert!(moved.face(face ^ 1).0.abs_diff_eq(opposite, 1e-9));
            moved.move_face(face, -1e9);
            assert!(moved.size.min_element() > 0.0 && moved.face(face ^ 1).0.abs_diff_eq(opposite, 1e-9));
        }
    }

    #[test]
    fn a_brush_finds_what_it_passes_over() {
        let (gaussians, camera) = (grid(), camera());
        let middle = DVec2::new(50.0, 40.0);
        let brush = Brush { camera: &camera, ends: [middle; 2], radius: 1.0, in_front_of: None };
        assert_eq!(brush.found(&gaussians).count(), 7, "the points of the optical axis");
        // Along x at the depth of the origin points are 10 pixels apart.
        let stroke = Brush { ends: [middle, middle + DVec2::new(20.0, 0.0)], ..brush };
        let found = stroke.found(&gaussians);
        assert!(found.iter().all(|i| place(&gaussians, i).y == 0.0 && place(&gaussians, i).x >= 0.0));
        assert_eq!(found.iter().filter(|&i| place(&gaussians, i).z == 0.0).count(), 3);
        // The surface lies at the depth of z = -1: the points before it are those at -3, -2 and -1.
        let mut depths = vec![9.0; 8000];
        let seen = Brush { in_front_of: Some(&depths), ..brush };
        assert_eq!(seen.found(&gaussians).count(), 3);
        depths[40 * 100 + 50] = 0.0;
        let open = Brush { in_front_of: Some(&depths), ..brush };
        assert_eq!(open.found(&gaussians).count(), 7, "where nothing is met nothing hides");
        // Behind the camera there is nothing to see.
        let behind = Camera { translation: DVec3::new(0.0, 0.0, -10.0), ..camera };
        assert_eq!(Brush { camera: &behind, radius: 1e9, ..brush }.found(&gaussians).count(), 0);
    }

    #[test]
    fn filters_find_what_meets_all_limits() {
        let gaussians = grid();
        let all = gaussians.len();
        let count = |filter: Filter| filter.found(&gaussians).count();
        assert_eq!(count(Filter::default()), 0, "no limit finds nothing");
        let faint = Filter { opacity_below: Some(0.5), ..Filter::default() };
        assert_eq!(count(faint), 171);
        assert_eq!(count(Filter { opacity_below: Some(1.1), ..faint }), all);
        // In scene units every standard deviation is twice that of the file.
        let large = Filter { scale_above: Some(2.0 * 0.01 * 300.5), ..Filter::default() };
        assert_eq!(count(large), all - 300);
        let far = Filter { farther: Some((DVec3::ZERO, 5.0)), ..Filter::default() };
        assert_eq!(count(far), 8, "the corners");
        assert_eq!(count(Filter { farther: far.farther, ..faint }), 4);
    }
}
