//! Why a pixel of a frame looks as it does: its surface, and what each source photo says about it (method.md sections 3 to 6).
//!
//! Colours, surface and which sources are used are read from the frame, as the GPU left them. Places, depths and colours in
//! the photos, which it does not keep, are computed again in double precision: within rounding of a limit they may fall on the
//! other side of it.

use crate::camera::Camera;
use crate::dataset::Photo;
use crate::gpu::{Buffer, Gpu, GpuError, at_once};
use crate::render::{Frame, FrameSource};
use crate::sources::WarpOptions;
use crate::sources::source_store::pixels;
use glam::{DVec2, DVec3};

/// One pixel of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Inspection {
    /// Column and row.
    pub pixel: [u32; 2],
    /// Base colour, RGB.
    pub base: [f32; 3],
    /// Final colour; none where the model has no network.
    pub image: Option<[f32; 3]>,
    /// Final minus base colour; what exposure correction and the sources' share change is a part of it.
    pub residual: Option<[f32; 3]>,
    /// Median depth z in scene units; none where nothing is met or the frame has no surface.
    pub median_depth: Option<f32>,
    /// The point at the median depth, world space.
    pub point: Option<DVec3>,
    /// Sum of w n_c in camera space, not normalised; none where nothing is met or the frame has no surface.
    pub normal: Option<[f32; 3]>,
    /// The median intersections front to back, those with a weight: at most K.
    pub intersections: Vec<Intersection>,
    /// The frame's sources in the order in which they are tested; empty where the pixel has no median depth.
    pub sources: Vec<SourceReading>,
}

/// Where a pixel's ray meets a Gaussian's plane (method.md section 3).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intersection {
    /// View depth z_k in scene units.
    pub depth: f32,
    /// Blending weight w_k.
    pub weight: f32,
    /// The point, world space.
    pub point: DVec3,
    /// Whether it is of the buffer *before*: more than half of the light still came from here or from behind.
    pub before: bool,
}

/// What one source says about a pixel (method.md section 5).
#[derive(Clone, Debug, PartialEq)]
pub struct SourceReading {
    /// The training view: index into [`ImagePart::cameras`](crate::render::ImagePart::cameras).
    pub view: usize,
    /// Whether the network reads the source at this pixel.
    pub verdict: Verdict,
    /// Where the point at the median depth falls in the photo, in pixels with centres at +0.5; none behind or outside.
    pub place: Option<DVec2>,
    /// `|zs - z| / z` of the point's depth z in the source and the source's own median depth zs there; none without either.
    pub depth_error: Option<f32>,
    /// The source sees the point where `depth_error` is less than this.
    pub depth_limit: f32,
    /// The photo's colour at each of [`Inspection::intersections`]; none where it falls behind, outside or on a mask.
    pub reads: Vec<Option<[f32; 3]>>,
    /// Their mean by weight: the colour that enters the network where the source is used.
    pub color: Option<[f32; 3]>,
    /// Cosine of the angle between the rays of frame and source to the point at the median depth.
    pub cosine: f32,
}

/// Whether a source is used at a pixel, or the first test that it failed (method.md section 5).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It is one of the visible sources of the pixel.
    Used {
        /// Which one, from 0.
        number: u32,
    },
    /// The point lies behind the source.
    Behind,
    /// The point falls outside of the photo.
    Outside,
    /// The source's own depth map has nothing there.
    NoDepth,
    /// The depths disagree: something else hides the point, or one of the depths is wrong.
    Hidden,
    /// The depths agree, but no intersection can be read: all fall on masked texels or outside.
    Unreadable,
    /// It sees the point, but the network already reads its full number of sources before this one.
    Enough,
}

/// Where a point falls in a source's photo.
struct Landing {
    place: DVec2,
    /// View depth in the source.
    depth: f64,
    /// The texels of the bilinear read (top left, top right, bottom left, bottom right), and their weights.
    texels: [usize; 4],
    weights: [f64; 4],
}

impl FrameSource {
    /// Where a point falls; `ray_offset` is [`SurfaceOptions::ray_offset`](crate::raster::SurfaceOptions).
    fn land(&self, point: DVec3, ray_offset: f64) -> Result<Landing, Verdict> {
        let Camera { width, height, .. } = self.camera;
        let (uv, depth) = self.camera.project(point);
        if depth.is_nan() || depth <= 0.0 {
            return Err(Verdict::Behind);
        }
        // The texel with index x lies at x.
        let at = uv - ray_offset;
        let last = DVec2::new(f64::from(width), f64::from(height)) - 1.0;
        if !(at.cmpge(DVec2::ZERO).all() && at.cmple(last).all() && last.cmpge(DVec2::ONE).all()) {
            return Err(Verdict::Outside);
        }
        // On the far edge the last pair of texels is read with a fraction of one.
        let first = at.floor().min(last - 1.0);
        let (row, texel) = (width as usize, first.y as usize * width as usize + first.x as usize);
        let (f, rest) = (at - first, 1.0 - (at - first));
        Ok(Landing {
            place: at + 0.5,
            depth,
            texels: [texel, texel + 1, texel + row, texel + row + 1],
            weights: [rest.x * rest.y, f.x * rest.y, rest.x * f.y, f.x * f.y],
        })
    }

    /// The photo's colour there; none where a texel is masked.
    fn color(photo: &Photo, landing: &Landing) -> Option<DVec3> {
        let texels = landing.texels.map(|t| photo.rgba.as_chunks::<4>().0[t]);
        let color = |[r, g, b, _]: [u8; 4]| DVec3::new(r.into(), g.into(), b.into()) / 255.0;
        let sum = texels.iter().zip(landing.weights).map(|(texel, weight)| weight * color(*texel)).sum();
        texels.iter().all(|texel| texel[3] >= 128).then_some(sum)
    }

    /// The source's own depth there; not positive where it has none.
    async fn own_depth(&self, gpu: &Gpu, landing: &Landing) -> Result<f64, GpuError> {
        let row = |first| gpu.read_at_async(&self.depth, landing.texels[first], 2);
        let texels = [row(0).await?, row(2).await?].concat();
        Ok(texels.iter().zip(landing.weights).map(|(z, weight)| weight * f64::from(*z)).sum())
    }
}

/// Byte where there is no visible source.
const EMPTY: u8 = 255;
/// Keeps the division by the sum of weights finite (method.md section 5).
const EPSILON: f64 = 1e-8;

/// A pixel that has sources.
struct Pixel<'a> {
    gpu: &'a Gpu,
    options: WarpOptions,
    /// The camera's centre and the point at the median depth; all is local here.
    center: DVec3,
    point: DVec3,
    ray_offset: f64,
    intersections: &'a [Intersection],
    /// Number of each visible source.
    packed: [u8; 4],
}

impl Pixel<'_> {
    /// The photo's colours at the intersections, and their mean by weight.
    fn colors(&self, source: &FrameSource, photo: &Photo) -> (Vec<Option<DVec3>>, Option<DVec3>) {
        let read = |i: &Intersection| FrameSource::color(photo, &source.land(i.point, self.ray_offset).ok()?);
        let reads: Vec<Option<DVec3>> = self.intersections.iter().map(read).collect();
        let (mut sum, mut weights) = (DVec3::ZERO, 0.0);
        for (color, intersection) in reads.iter().zip(self.intersections) {
            if let Some(color) = color {
                sum += f64::from(intersection.weight) * color;
                weights += f64::from(intersection.weight);
            }
        }
        (reads, (weights > 0.0).then(|| sum / (weights + EPSILON)))
    }

    /// What the source with this number says.
    async fn read(&self, number: usize, source: &FrameSource) -> Result<SourceReading, GpuError> {
        let landing = source.land(self.point, self.ray_offset);
        let (reads, color) = self.colors(source, &*pixels(&source.photo)?);
        let mut depth_error = None;
        if let Ok(landing) = &landing {
            let own = source.own_depth(self.gpu, landing).await?;
            depth_error = (own > 0.0).then(|| ((own - landing.depth).abs() / landing.depth) as f32);
        }
        let WarpOptions { visible, agreement, reach } = self.options;
        let agreement = reach * agreement;
        let found = self.packed.iter().position(|&byte| byte != EMPTY && usize::from(byte & 15) == number);
        let full = self.packed[visible as usize - 1] != EMPTY;
        let verdict = match (found, &landing, depth_error) {
            (Some(number), ..) => Verdict::Used { number: number as u32 },
            (None, Err(verdict), _) => *verdict,
            (None, Ok(_), None) => Verdict::NoDepth,
            (None, Ok(_), Some(error)) if error < agreement && color.is_none() => Verdict::Unreadable,
            (None, Ok(_), Some(error)) if error < agreement && full => Verdict::Enough,
            // Also where they agree by less than rounding.
            (None, Ok(_), Some(_)) => Verdict::Hidden,
        };
        let ray = |center: DVec3| (self.point - center).normalize_or_zero();
        let rgb = |color: Option<DVec3>| color.map(|color| color.as_vec3().to_array());
        Ok(SourceReading {
            view: source.view,
            verdict,
            place: landing.ok().map(|landing| landing.place),
            depth_error,
            depth_limit: agreement,
            reads: reads.into_iter().map(rgb).collect(),
            color: rgb(color),
            cosine: ray(self.center).dot(ray(source.camera.center())) as f32,
        })
    }
}

impl Frame {
    /// From local coordinates to the scene's.
    fn to_scene(&self, found: &mut Inspection) {
        found.median_depth = found.median_depth.map(|z| self.in_scene_units(z));
        found.point = found.point.map(|point| self.space.to_scene(point));
        for hit in &mut found.intersections {
            (hit.depth, hit.point) = (self.in_scene_units(hit.depth), self.space.to_scene(hit.point));
        }
    }

    /// What a pixel shows and why; none outside of the image. Reads some dozens of values and waits for the GPU.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn inspect(&self, x: u32, y: u32) -> Result<Option<Inspection>, GpuError> {
        at_once(self.inspect_async(x, y))
    }

    /// As [`Frame::inspect`], for browsers.
    ///
    /// # Errors
    /// When the device is lost.
    pub async fn inspect_async(&self, x: u32, y: u32) -> Result<Option<Inspection>, GpuError> {
        let (gpu, camera) = (&*self.gpu, &self.local);
        if x >= camera.width || y >= camera.height {
            return Ok(None);
        }
        let at = y as usize * camera.width as usize + x as usize;
        let color = async |memory: &Buffer<f32>| -> Result<[f32; 3], GpuError> {
            let values = gpu.read_at_async(memory, 3 * at, 3).await?;
            Ok([values[0], values[1], values[2]])
        };
        let base = color(self.base_memory()).await?;
        let image = match self.image_memory() {
            Some(memory) => Some(color(memory).await?),
            None => None,
        };
        let residual = image.map(|image| std::array::from_fn(|c| image[c] - base[c]));
        let mut found = Inspection { pixel: [x, y], base, image, residual, ..Inspection::default() };
        let Some(surface) = self.surface() else { return Ok(Some(found)) };
        // Of the pixel's ray, at view depth z.
        let uv = DVec2::new(f64::from(x), f64::from(y)) + surface.options.ray_offset;
        let point = |z: f32| camera.unproject(uv, f64::from(z));
        found.normal = Some(color(&surface.normal_map).await?).filter(|normal| *normal != [0.0; 3]);
        let median = gpu.read_at_async(&surface.median_depth, at, 1).await?[0];
        found.median_depth = Some(median).filter(|&z| z > 0.0 && z.is_finite());
        found.point = found.median_depth.map(point);
        let (count, pixels) = (surface.options.intersections as usize, camera.width as usize * camera.height as usize);
        for k in 0..count {
            let [depth, weight] = gpu.read_at_async(&surface.intersections, k * pixels + at, 1).await?[0];
            if weight > 0.0 {
                found.intersections.push(Intersection { depth, weight, point: point(depth), before: k < count / 2 });
            }
        }
        if let Some((part, seen)) = self.image.as_ref().and_then(|part| Some((part, part.seen.as_ref()?)))
            && let Some(point) = found.point
        {
            let packed = gpu.read_at_async(&seen.visible, at, 1).await?[0].to_le_bytes();
            let (center, ray_offset) = (camera.center(), surface.options.ray_offset);
            let intersections = &found.intersections;
            let pixel = Pixel { gpu, options: part.options, center, point, ray_offset, intersections, packed };
            let mut readings = Vec::with_capacity(part.sources.len());
            for (number, source) in part.sources.iter().enumerate() {
                readings.push(pixel.read(number, source).await?);
            }
            found.sources = readings;
        }
        self.to_scene(&mut found);
        Ok(Some(found))
    }
}
