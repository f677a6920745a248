//! Twin of the warping kernel (method.md section 5): colours of the source photos at a pixel's median intersections,
//! visibility by the sources' own depth maps, packing and features.

use glam::{DMat3, DVec2, DVec3};
use ibgs_data::camera::Camera;
use rayon::prelude::*;

use super::geometry::{EPSILON, Geometry, Intersection, pixel_ray};

/// The depths of source and point agree when they differ by less than this part of the latter.
pub const DEPTH_AGREEMENT: f64 = 0.01;

/// Sources are packed up to this many times the agreement where a confidence weighs them.
pub const SOFT_REACH: f64 = 5.0;

/// A source view. Its images have the size of its camera, row by row.
#[derive(Clone, Debug)]
pub struct Source {
    pub camera: Camera,
    /// Colours in 0..1.
    pub photo: Vec<[f64; 3]>,
    /// Texels of the photo that are not masked.
    pub valid: Vec<bool>,
    /// The view's own median depth, a constant; 0 where it met nothing.
    pub depth: Vec<f64>,
    /// Packed where its depth differs by less than this many times [`DEPTH_AGREEMENT`].
    pub reach: f64,
}

/// What `warp` gives: per visible source m, then per pixel; zero (and source -1) where there is none.
#[derive(Clone, Debug, PartialEq)]
pub struct Warp {
    /// Number of visible source m of the pixel, or -1.
    pub source: Vec<i32>,
    /// Thirds of the agreement by which the source's depth is off, rounded down; 0 with a reach of 1.
    pub error: Vec<u8>,
    pub warped: Vec<[f64; 3]>,
    /// Target camera centre minus source camera centre (3, world), cosine of the angle between the viewing rays.
    pub feature: Vec<[f64; 4]>,
}

/// A bilinear read whose four texels all exist, texel centres at +0.5.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bilinear {
    /// Top left, top right, bottom left, bottom right.
    texels: [usize; 4],
    /// Position between the texel centres.
    fraction: DVec2,
}

impl Bilinear {
    /// None unless 0.5 <= u <= w - 0.5 and likewise for v.
    pub fn new(uv: DVec2, width: u32, height: u32) -> Option<Bilinear> {
        let inside = |u: f64, size: u32| size >= 2 && (0.5..=f64::from(size) - 0.5).contains(&u);
        if !(inside(uv.x, width) && inside(uv.y, height)) {
            return None;
        }
        // On the far edge the last pair of texels is read with a fraction of one.
        let first = |u: f64, size: u32| ((u - 0.5) as u32).min(size - 2);
        let (x, y) = (first(uv.x, width), first(uv.y, height));
        let (row, at) = (width as usize, (y * width + x) as usize);
        let fraction = uv - 0.5 - DVec2::new(f64::from(x), f64::from(y));
        Some(Bilinear { texels: [at, at + 1, at + row, at + row + 1], fraction })
    }

    fn sum<const N: usize>(&self, image: &[[f64; N]], weights: [f64; 4]) -> [f64; N] {
        std::array::from_fn(|c| self.texels.iter().zip(weights).map(|(t, w)| w * image[*t][c]).sum())
    }

    /// The value read.
    pub fn read<const N: usize>(&self, image: &[[f64; N]]) -> [f64; N] {
        let DVec2 { x: a, y: b } = self.fraction;
        self.sum(image, [(1.0 - a) * (1.0 - b), a * (1.0 - b), (1.0 - a) * b, a * b])
    }

    /// Whether all texels read are valid.
    fn is_valid(&self, valid: &[bool]) -> bool {
        self.texels.iter().all(|t| valid[*t])
    }

    /// Derivatives of the value read by u and by v.
    pub fn slope<const N: usize>(&self, image: &[[f64; N]]) -> [[f64; N]; 2] {
        let DVec2 { x: a, y: b } = self.fraction;
        [self.sum(image, [b - 1.0, 1.0 - b, -b, b]), self.sum(image, [a - 1.0, -a, 1.0 - a, a])]
    }
}

/// Where a point of a target pixel's ray falls in a source.
#[derive(Clone, Copy, Debug)]
pub struct Landing {
    pub read: Bilinear,
    /// View depth in the source, positive.
    pub depth: f64,
    /// Derivative of the pixel in the source by the view depth in the target.
    pub uv_by_depth: DVec2,
}

/// A source beside the target camera.
pub struct Pair<'a> {
    pub source: &'a Source,
    /// Source view space from target view space.
    pub(super) rotation: DMat3,
    pub(super) translation: DVec3,
    world_from_target: DMat3,
    /// Target camera centre minus source camera centre, world.
    pub center_difference: DVec3,
}

/// What a source that sees a pixel's point gives to it.
pub struct Seen {
    pub warped: [f64; 3],
    /// Difference of the source's depth from the point's, as a part of the latter.
    pub error: f64,
    /// Sum of the weights of the intersections inside, plus 1e-8.
    pub weight: f64,
    /// The intersections inside the source's image: index among the pixel's and where it falls.
    pub landings: Vec<(usize, Landing)>,
    pub cosine: f64,
    /// Derivative of the cosine by the median depth.
    pub cosine_by_depth: f64,
}

/// v / (|v| + 1e-8) and its derivative as v moves along `along`.
fn direction(v: DVec3, along: DVec3) -> (DVec3, DVec3) {
    let length = v.length();
    let soft = length + EPSILON;
    let unit = v / soft;
    let stretch = if length > 0.0 { v.dot(along) / length } else { 0.0 };
    (unit, (along - unit * stretch) / soft)
}

impl<'a> Pair<'a> {
    pub fn new(target: &Camera, source: &'a Source) -> Pair<'a> {
        let world_from_target = target.view_from_world.transpose();
        let rotation = source.camera.view_from_world * world_from_target;
        Pair {
            source,
            rotation,
            translation: source.camera.translation - rotation * target.translation,
            world_from_target,
            center_difference: target.center() - source.camera.center(),
        }
    }

    /// The point at view depth `z` on the target's ray; None behind the source or outside its image.
    pub fn land(&self, ray: DVec3, z: f64) -> Option<Landing> {
        let Camera { focal, principal, width, height, .. } = self.source.camera;
        let along = self.rotation * ray;
        let point = along * z + self.translation;
        if point.z.is_nan() || point.z <= 0.0 {
            return None;
        }
        let ratio = point.truncate() / point.z;
        let read = Bilinear::new(focal * ratio + principal, width, height)?;
        let uv_by_depth = focal * (along.truncate() - ratio * along.z) / point.z;
        Some(Landing { read, depth: point.z, uv_by_depth })
    }

    /// Cosine of the angle between the target's and the source's rays to the median point, and its derivative by the
    /// median depth. Departs from the published code, which lets no gradient through (method.md 10.4).
    fn cosine(&self, ray: DVec3, depth: f64) -> (f64, f64) {
        let along = self.world_from_target * ray;
        let (a, a_by_depth) = direction(along * depth, along);
        let (b, b_by_depth) = direction(along * depth + self.center_difference, along);
        (a.dot(b), a_by_depth.dot(b) + a.dot(b_by_depth))
    }

    /// Steps 1 and 2 of section 5 for one pixel: None where the source does not see the point at the median `depth`.
    pub fn see(&self, ray: DVec3, intersections: &[Intersection], depth: f64) -> Option<Seen> {
        let median = self.land(ray, depth)?;
        let [stored] = median.read.read(self.source.depth.as_chunks().0);
        let error = (stored - median.depth).abs() / median.depth;
        let agrees = stored > 0.0 && error < self.source.reach * DEPTH_AGREEMENT;
        // A read that touches a masked texel does not count.
        let unmasked = |landing: &Landing| landing.read.is_valid(&self.source.valid);
        let land = |(k, met): (usize, &Intersection)| Some((k, self.land(ray, met.depth).filter(unmasked)?));
        let landings: Vec<_> = intersections.iter().enumerate().filter_map(land).collect();
        if !agrees || landings.is_empty() {
            return None;
        }
        let weight = landings.iter().map(|(k, _)| intersections[*k].weight).sum::<f64>() + EPSILON;
        let mut warped = [0.0; 3];
        for (k, landing) in &landings {
            for (sum, c) in warped.iter_mut().zip(landing.read.read(&self.source.photo)) {
                *sum += intersections[*k].weight * c / weight;
            }
        }
        let (cosine, cosine_by_depth) = self.cosine(ray, depth);
        Some(Seen { warped, error, weight, landings, cosine, cosine_by_depth })
    }
}

/// Step 3 of section 5 for one pixel: the sources that see it, in order, with their numbers.
pub fn seen_by(camera: &Camera, geometry: &Geometry, pairs: &[Pair], pixel: usize) -> Vec<(usize, Seen)> {
    let ray = pixel_ray(camera, pixel as u32 % camera.width, pixel as u32 / camera.width);
    let see =
        |(m, pair): (usize, &Pair)| Some((m, pair.see(ray, &geometry.intersections[pixel], geometry.depth[pixel])?));
    pairs.iter().enumerate().filter_map(see).collect()
}

/// Warps all sources to the target view. Every visible source is packed; the caller uses the first V.
pub fn warp(camera: &Camera, geometry: &Geometry, sources: &[Source]) -> Warp {
    let pairs: Vec<Pair> = sources.iter().map(|s| Pair::new(camera, s)).collect();
    let pixels = geometry.depth.len();
    let seen: Vec<_> = (0..pixels).into_par_iter().map(|i| seen_by(camera, geometry, &pairs, i)).collect();

    let entries = sources.len() * pixels;
    let mut out = Warp {
        source: vec![-1; entries],
        error: vec![0; entries],
        warped: vec![[0.0; 3]; entries],
        feature: vec![[0.0; 4]; entries],
    };
    for (pixel, packed) in seen.into_iter().enumerate() {
        for (m, (source, seen)) in packed.into_iter().enumerate() {
            let at = m * pixels + pixel;
            out.source[at] = source as i32;
            let steps = if sources[source].reach > 1.0 { 3.0 } else { 0.0 };
            out.error[at] = (steps * seen.error / DEPTH_AGREEMENT) as u8;
            out.warped[at] = seen.warped;
            out.feature[at] = pairs[source].center_difference.extend(seen.cosine).to_array();
        }
    }
    out
}
