//! Points in the visual hull: what no photo of an object shows to be empty (Laurentini, 1994). A tree of cubes is carved by the
//! photos' alpha; the cubes that are left give the points.

use super::{ALPHA_EMPTY, DatasetError, Photo, Point, View};
use crate::camera::Camera;
use glam::{DVec2, DVec3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use std::sync::Arc;

/// Cells along the first cube's side, before it is divided further.
const FIRST: i32 = 8;
/// Divisions after which a cell must be within the images of many views; larger ones reach out of them.
const FINE: u32 = 2;
/// Divisions of those cells at most.
const MOST_DIVISIONS: u32 = 6;
/// Cells are divided until there are this many for each point.
const CELLS_PER_POINT: usize = 4;
/// Points for each view at most: few photos do not tell which of many are inside of the object, and they stay as fog.
const POINTS_PER_VIEW: usize = 150;
/// A cell stays though one of so many views shows it to be empty: masks err.
const ASTRAY: usize = 50;
/// Views that must show a cell, and the least share of all.
const LEAST_VIEWS: usize = 3;
const LEAST_SHARE: f64 = 0.25;
/// Alpha, as a share, from which a pixel counts as covered.
const COVERED: f64 = 0.1;

/// Which pixels of a view the object covers, as sums over rectangles.
struct Silhouette {
    camera: Camera,
    photo: Arc<Photo>,
    /// `(width + 1) * (height + 1)`: covered pixels above and left.
    sums: Vec<u32>,
}

/// What a view says about a ball.
#[derive(PartialEq)]
enum Seen {
    /// It reaches out of the image.
    Not,
    Empty,
    Covered,
}

impl Silhouette {
    fn new(camera: Camera, photo: Arc<Photo>) -> Self {
        let (width, height) = (photo.width as usize, photo.height as usize);
        let least = f64::from(ALPHA_EMPTY) + COVERED * f64::from(u8::MAX - ALPHA_EMPTY);
        let mut sums = vec![0; (width + 1) * (height + 1)];
        for y in 0..height {
            let mut row = 0;
            for x in 0..width {
                // Where there is no photo the object may be.
                let alpha = photo.rgba[4 * (y * width + x) + 3];
                row += u32::from(alpha == 0 || f64::from(alpha) >= least);
                sums[(y + 1) * (width + 1) + x + 1] = sums[y * (width + 1) + x + 1] + row;
            }
        }
        Self { camera, photo, sums }
    }

    /// Looks at the square around the image of a ball.
    fn look(&self, centre: DVec3, radius: f64) -> Seen {
        let view = self.camera.to_view(centre);
        if view.z <= 2.0 * radius {
            return Seen::Not;
        }
        let at = self.camera.focal * view.truncate() / view.z + self.camera.principal;
        let reach = self.camera.focal * radius / (view.z - radius);
        let [low, high] = [(at - reach).floor(), (at + reach).ceil()];
        let size = DVec2::new(f64::from(self.photo.width), f64::from(self.photo.height));
        if low.cmplt(DVec2::ZERO).any() || high.cmpgt(size).any() {
            return Seen::Not;
        }
        let [x0, y0, x1, y1] = [low.x, low.y, high.x, high.y].map(|v| v as usize);
        let sum = |x: usize, y: usize| self.sums[y * (self.photo.width as usize + 1) + x];
        let covered = sum(x1, y1) + sum(x0, y0) - sum(x1, y0) - sum(x0, y1);
        if covered == 0 { Seen::Empty } else { Seen::Covered }
    }

    /// The colour of the object there; none outside of it.
    fn color(&self, place: DVec3) -> Option<[u8; 3]> {
        let (at, _) = self.camera.seen(place)?;
        let index = 4 * (at.y as usize * self.photo.width as usize + at.x as usize);
        let [r, g, b, a] = [0, 1, 2, 3].map(|c| self.photo.rgba[index + c]);
        (a >= 128).then_some([r, g, b])
    }
}

/// Cubes of one size that are left, by their numbers along the axes.
struct Cells {
    corner: DVec3,
    side: f64,
    left: Vec<[i32; 3]>,
}

impl Cells {
    fn centre(&self, cell: [i32; 3]) -> DVec3 {
        self.corner + (DVec3::from(cell.map(f64::from)) + 0.5) * self.side
    }

    /// Removes what the silhouettes show to be empty, and what is within the images of few.
    fn carve(&mut self, silhouettes: &[Silhouette], divisions: u32) {
        let least = LEAST_VIEWS.max((LEAST_SHARE * silhouettes.len() as f64) as usize).min(silhouettes.len());
        let least = if divisions < FINE { 0 } else { least };
        let radius = 0.5 * 3f64.sqrt() * self.side;
        let stays = |cell: &[i32; 3]| {
            let centre = self.centre(*cell);
            let (mut empty, mut covered) = (0, 0);
            for silhouette in silhouettes {
                match silhouette.look(centre, radius) {
                    Seen::Not => {}
                    Seen::Empty => empty += 1,
                    Seen::Covered => covered += 1,
                }
            }
            empty <= silhouettes.len() / ASTRAY && covered >= least
        };
        self.left = self.left.par_iter().copied().filter(stays).collect();
    }

    fn divided(&self) -> Self {
        let children = |cell: &[i32; 3]| {
            let cell = *cell;
            (0..8).map(move |i| std::array::from_fn(|a| 2 * cell[a] + (i >> a & 1)))
        };
        Self { side: 0.5 * self.side, left: self.left.iter().flat_map(children).collect(), ..*self }
    }
}

/// The point that the optical axes pass closest to, by least squares, and the median distance of the cameras from it.
fn focus(views: &[&View]) -> (DVec3, f64) {
    let (mut a, mut b) = (glam::DMat3::ZERO, DVec3::ZERO);
    for view in views {
        let axis = view.camera.forward();
        let across = glam::DMat3::IDENTITY - glam::DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
        a += across;
        b += across * view.camera.center();
    }
    let middle = views.iter().map(|view| view.camera.center()).sum::<DVec3>() / views.len().max(1) as f64;
    let focus = if a.determinant().abs() > 1e-6 * views.len() as f64 { a.inverse() * b } else { middle };
    let mut distances: Vec<f64> = views.iter().map(|view| view.camera.center().distance(focus)).collect();
    distances.sort_by(f64::total_cmp);
    (focus, distances.get(distances.len() / 2).copied().unwrap_or_default())
}

/// Points in the visual hull of these views, whose alpha says what the object covers: at most `most`, and not more than the views
/// can tell apart, spread evenly, in colours that are the median of the photos that show them. Empty where the photos leave nothing.
/// The same for the same seed.
///
/// # Errors
/// A photo that cannot be decoded again.
pub(super) fn points(views: &[&View], most: usize, seed: u64) -> Result<Vec<Point>, DatasetError> {
    let count = most.min(POINTS_PER_VIEW * views.len());
    let silhouette = |view: &&View| Ok(Silhouette::new(view.camera, view.photo.pixels()?));
    let silhouettes = views.par_iter().map(silhouette).collect::<Result<Vec<_>, DatasetError>>()?;
    let (middle, distance) = focus(views);
    if !(distance > 0.0 && distance.is_finite()) {
        return Ok(Vec::new());
    }
    let first = (0..FIRST).flat_map(|x| (0..FIRST).flat_map(move |y| (0..FIRST).map(move |z| [x, y, z])));
    let mut cells = Cells { corner: middle - distance, side: 2.0 * distance / f64::from(FIRST), left: first.collect() };
    cells.carve(&silhouettes, 0);
    for division in 1..=MOST_DIVISIONS {
        cells = cells.divided();
        cells.carve(&silhouettes, division);
        if cells.left.is_empty() || division >= FINE && cells.left.len() >= CELLS_PER_POINT * count {
            break;
        }
    }
    if cells.left.is_empty() {
        return Ok(Vec::new());
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let places: Vec<DVec3> = (0..count)
        .map(|_| {
            let cell = cells.left[rng.random_range(0..cells.left.len())];
            let offset = DVec3::from(std::array::from_fn::<f64, 3, _>(|_| rng.random::<f64>() - 0.5));
            cells.centre(cell) + offset * cells.side
        })
        .collect();
    Ok(places.into_par_iter().map(|position| Point { position, color: color(position, &silhouettes) }).collect())
}

/// Median by channel of what the photos show there; grey where none shows the object.
fn color(place: DVec3, silhouettes: &[Silhouette]) -> [u8; 3] {
    let colors: Vec<[u8; 3]> = silhouettes.iter().filter_map(|silhouette| silhouette.color(place)).collect();
    [0, 1, 2].map(|c| {
        let mut levels: Vec<u8> = colors.iter().map(|color| color[c]).collect();
        let middle = levels.len() / 2;
        if levels.is_empty() { 128 } else { *levels.select_nth_unstable(middle).1 }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;

    /// Cameras on a sphere around `middle` that see a red ball of this radius on nothing.
    fn views(middle: DVec3, radius: f64, count: u32) -> Vec<View> {
        let view = |i: u32| {
            let (angle, height) = (2.4 * f64::from(i), 1.6 * (f64::from(i) + 0.5) / f64::from(count) - 0.8);
            let around = (1.0 - height * height).sqrt();
            let out = DVec3::new(around * angle.cos(), around * angle.sin(), height);
            let z = -out;
            let x = z.cross(DVec3::Z).normalize();
            let view_from_world = DMat3::from_cols(x, z.cross(x), z).transpose();
            let center = middle + 8.0 * radius * out;
            let camera = Camera {
                width: 100,
                height: 80,
                focal: DVec2::splat(180.0),
                principal: DVec2::new(50.0, 40.0),
                view_from_world,
                translation: -(view_from_world * center),
            };
            let alpha = |pixel: u32| {
                let ray = camera.ray(DVec2::new(f64::from(pixel % 100) + 0.5, f64::from(pixel / 100) + 0.5));
                let nearest = (middle - center).dot(ray);
                let hits = (center + nearest * ray).distance(middle) <= radius;
                if hits { [200, 10, 10, 255] } else { [0, 0, 0, ALPHA_EMPTY] }
            };
            let rgba = (0..8_000).flat_map(alpha).collect();
            View { name: i.to_string(), camera, photo: Photo { width: 100, height: 80, rgba }.into() }
        };
        (0..count).map(view).collect()
    }

    #[test]
    fn the_hull_of_a_ball_is_the_ball() {
        // In any place and unit.
        for (middle, radius) in [(DVec3::ZERO, 1.0), (DVec3::new(900.0, -50.0, 3.0), 40.0)] {
            let views = views(middle, radius, 40);
            let views: Vec<&View> = views.iter().collect();
            let points = points(&views, 4_000, 3).unwrap();
            assert_eq!(points.len(), 4_000);
            let distances: Vec<f64> = points.iter().map(|p| p.position.distance(middle) / radius).collect();
            let farthest = distances.iter().fold(0.0, |a: f64, &b| a.max(b));
            assert!(farthest < 1.25, "{farthest}");
            // Evenly: a ball of half the volume holds half of them.
            let inner = distances.iter().filter(|d| **d < 0.5f64.cbrt() * farthest).count();
            assert!((1_700..2_600).contains(&inner), "{inner}");
            assert!(points.iter().all(|p| p.color == [200, 10, 10] || p.position.distance(middle) > radius));
            // On all sides of it.
            for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                let ahead = points.iter().filter(|p| (p.position - middle).dot(axis) > 0.0).count();
                assert!((1_500..2_500).contains(&ahead), "{ahead}");
            }
        }
    }

    #[test]
    fn one_wrong_mask_of_many_carves_nothing_and_no_object_gives_none() {
        let mut views = views(DVec3::ZERO, 1.0, 60);
        views[7].photo = Photo { width: 100, height: 80, rgba: [0, 0, 0, ALPHA_EMPTY].repeat(8_000) }.into();
        assert_eq!(points(&views.iter().collect::<Vec<_>>(), 1_000, 0).unwrap().len(), 1_000);
        for view in &mut views {
            view.photo = Photo { width: 100, height: 80, rgba: [0, 0, 0, ALPHA_EMPTY].repeat(8_000) }.into();
        }
        assert!(points(&views.iter().collect::<Vec<_>>(), 1_000, 0).unwrap().is_empty());
    }
}
