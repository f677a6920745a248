//! Warping of source photos to a target view through its median intersections (method.md section 5), and the
//! gradients by them.

use super::DevicePhoto;
use crate::camera::Camera;
use crate::gpu::pool::{Lease, Pool};
use crate::gpu::{Buffer, Gpu, GpuError, Pass};
use crate::raster::{CameraGradients, Forward, Surface};
use ibgs_shaders::bindings::{CameraWarpBindings, WarpBackwardBindings, WarpBindings, WarpFourBindings};
use ibgs_shaders::types::{SourceParams, VisibleParams, WarpParams};
use ibgs_shaders::{CAMERA_GROUPS, TILE, WARP_FOUR};
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::Arc;

/// A source view: its camera, its photo and its own median depth `[H * W]` (0 where it met nothing). The depth is data: no
/// gradient flows into it.
#[derive(Clone, Debug)]
pub struct SourceView {
    /// Camera of the photo.
    pub camera: Camera,
    /// The photo.
    pub photo: DevicePhoto,
    /// The view's own median depth.
    pub depth: Buffer<f32>,
}

/// How photos are warped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WarpOptions {
    /// Visible sources a pixel, V, 1 to 4: the first that see it.
    pub visible: u32,
    /// The depths of source and point agree when they differ by less than this part of the latter.
    pub agreement: f32,
    /// A source is packed when they differ by less than this many times that: 1, or up to 5 where a confidence weighs the sources.
    pub reach: f32,
}

impl WarpOptions {
    /// The reach where a confidence weighs the sources.
    pub const SOFT_REACH: f32 = 5.0;
}

impl Default for WarpOptions {
    fn default() -> Self {
        Self { visible: 3, agreement: 0.01, reach: 1.0 }
    }
}

/// Which pixels of the final image differ from the base image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Reach {
    /// Any, as published: the network also guesses where no source sees a pixel's point.
    #[default]
    Everywhere,
    /// Those that see a source: where a view shows nothing the background stays. A departure from method.md.
    Seen,
}

/// Which sources the pixels see.
#[derive(Debug)]
pub struct Seen {
    /// `[P]` u32: byte m has the number of visible source m in its low half and the error of its depth, in thirds of
    /// what agrees, in its high half (0 with a reach of 1); 255 where there is none. A pixel's visible sources come first,
    /// without gaps.
    pub visible: Buffer<u32>,
    /// `[4]` words, the first: most visible sources of any pixel.
    pub most_visible: Buffer<u32>,
    /// `[M]` of (target camera centre - source camera centre, 0), world space.
    pub centers: Buffer<[f32; 4]>,
    /// Number of sources M.
    pub sources: u32,
    /// `[M]`: where they are, for the warping's kernels.
    params: Buffer<SourceParams>,
    pixels: usize,
}

/// Most visible sources of a pixel, V: their numbers share a word of four bytes.
pub const MAX_VISIBLE: u32 = 4;
/// Most sources of a target, M.
pub const MAX_SOURCES: usize = 8;

/// Warps; owns its scratch memory.
#[derive(Debug)]
pub struct Warper {
    gpu: Arc<Gpu>,
    pool: Arc<Pool<Seen>>,
    /// How.
    pub options: WarpOptions,
}

/// Warped sources and what their gradients need.
#[derive(Clone, Debug)]
pub struct Warped {
    /// `[V, P, 4]`: the colour of each visible source and the cosine of the angle between the viewing rays; zero where
    /// there is none.
    pub colors: Buffer<[f32; 4]>,
    /// Which sources the pixels see.
    pub seen: Arc<Lease<Seen>>,
    /// Visible sources a pixel, V.
    pub visible: u32,
    surface: Arc<Lease<Surface>>,
    sources: Vec<(SourceView, SourceParams)>,
    options: WarpOptions,
    cameras: Option<CameraGradients>,
}

impl Warped {
    /// What a kernel that goes over the colours needs.
    pub(crate) fn per_visible(&self) -> VisibleParams {
        VisibleParams { pixels: self.surface.camera.pixels() as u32, visible: self.visible }
    }

    /// Adds the gradients by the surface's depths and weights to the surface's own, where the rasterizer's backward pass reads
    /// them, from those by the colours, `[V, P, 4]`, and those by the cameras to [`Forward::cameras`].
    ///
    /// # Panics
    /// When the surface was made without gradients: a bug of ours.
    pub fn backward(&self, gpu: &Gpu, v_colors: &Buffer<[f32; 4]>) {
        let v = self.surface.v.as_ref().expect("a tracked surface has gradients");
        let mut pass = Pass::new(gpu, "warp backward");
        for round in rounds(&self.sources, &self.surface, &self.options, FOUR) {
            let [photo0, photo1, photo2, photo3] = round.sources.map(|source| &source.photo.texels);
            let buffers = WarpBackwardBindings {
                sources: &self.seen.params,
                median_depth: &self.surface.median_depth,
                intersections: &self.surface.intersections,
                warped: &self.colors,
                seen: &self.seen.visible,
                v_warped: v_colors,
                v_intersections: &v.intersections,
                v_median_depth: &v.median_depth,
                photo0,
                photo1,
                photo2,
                photo3,
            };
            pass.grid(&buffers, &round.params, tiles(round.params.size));
        }
        if let Some(cameras) = &self.cameras {
            for (source, params) in &self.sources {
                self.record_camera(&mut pass, (source, params), v_colors, cameras);
            }
        }
        pass.submit();
    }

    /// What the warping of a source says of its camera and of the target's.
    fn record_camera(
        &self,
        pass: &mut Pass,
        (source, params): (&SourceView, &SourceParams),
        v_colors: &Buffer<[f32; 4]>,
        cameras: &CameraGradients,
    ) {
        let bindings = CameraWarpBindings {
            median_depth: &self.surface.median_depth,
            intersections: &self.surface.intersections,
            photo: &source.photo.texels,
            seen: &self.seen.visible,
            v_warped: v_colors,
            partials: cameras.partials(),
        };
        pass.groups(&bindings, params, CAMERA_GROUPS as usize);
        cameras.record_both(pass, params.index);
    }
}

const LABEL: &str = "warp";

fn tiles(size: [u32; 2]) -> [u32; 3] {
    [size[0].div_ceil(TILE), size[1].div_ceil(TILE), 1]
}

fn params(surface: &Surface, source: &SourceView, index: usize, options: &WarpOptions) -> SourceParams {
    let (target, camera) = (&surface.camera, &source.camera);
    let [row0, row1, row2] = camera.rows_from(target);
    SourceParams {
        row0,
        row1,
        row2,
        focal: target.focal.as_vec2().to_array(),
        principal: surface.options.principal(target),
        source_focal: camera.focal.as_vec2().to_array(),
        source_principal: surface.options.principal(camera),
        size: [target.width, target.height],
        source_size: [camera.width, camera.height],
        index: index as u32,
        visible: options.visible,
        intersections: surface.options.intersections,
        ..SourceParams::default()
    }
}

/// Sources that a kernel goes over at once where the device binds enough buffers.
const FOUR: usize = 4;

/// Some sources in a row, for one dispatch.
struct Round<'a> {
    params: WarpParams,
    /// Where there are fewer, the last fills the other places, which are not read.
    sources: [&'a SourceView; FOUR],
}

/// All sources, `size` at once.
fn rounds<'a>(
    sources: &'a [(SourceView, SourceParams)],
    surface: &Surface,
    options: &WarpOptions,
    size: usize,
) -> impl Iterator<Item = Round<'a>> {
    let whole = WarpParams {
        size: [surface.camera.width, surface.camera.height],
        visible: options.visible,
        intersections: surface.options.intersections,
        agreement: options.agreement,
        reach: options.reach,
        ..WarpParams::default()
    };
    sources.chunks(size).zip((0..).step_by(size)).map(move |(round, first)| Round {
        params: WarpParams { first, count: round.len() as u32, ..whole },
        sources: std::array::from_fn(|s| &round[s.min(round.len() - 1)].0),
    })
}

impl Warper {
    /// A warper without any memory yet.
    pub fn new(gpu: Arc<Gpu>, options: WarpOptions) -> Self {
        Self { gpu, pool: Arc::default(), options }
    }

    /// The GPU it works on.
    pub fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    fn scratch(&self, pixels: usize) -> Result<Lease<Seen>, GpuError> {
        let make = || {
            Ok(Seen {
                visible: self.gpu.allocate("packed sources", pixels)?,
                most_visible: self.gpu.allocate("packed sources", 4)?,
                centers: self.gpu.allocate("source centres", MAX_SOURCES)?,
                sources: 0,
                params: self.gpu.allocate("packed sources", MAX_SOURCES)?,
                pixels,
            })
        };
        self.pool.lease_or(|seen: &Seen| seen.pixels >= pixels, make)
    }

    /// Which sources the pixels of some rows see, copied from what those of the whole view do.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn seen_in_rows(
        &self,
        pass: &mut Pass,
        warped: &Warped,
        rows: &Range<u32>,
    ) -> Result<Arc<Lease<Seen>>, GpuError> {
        let (width, whole) = (warped.surface.camera.width as usize, &warped.seen);
        let count = width * rows.len();
        let mut seen = self.scratch(count)?;
        seen.sources = whole.sources;
        pass.copy(&whole.visible.part(width * rows.start as usize, count), &seen.visible, 0, count);
        pass.copy(&whole.most_visible, &seen.most_visible, 0, 4);
        pass.copy(&whole.centers, &seen.centers, 0, MAX_SOURCES);
        Ok(Arc::new(seen))
    }

    /// Memory for a view's warped colours, `[V, P, 4]`.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn memory(&self, camera: &Camera) -> Result<Buffer<[f32; 4]>, GpuError> {
        self.gpu.transient("warped colours", self.options.visible as usize * camera.pixels())
    }

    /// Warps the sources, in their order, into `colors`.
    ///
    /// # Errors
    /// Not enough memory.
    ///
    /// # Panics
    /// Without a surface or a source: bugs of ours.
    pub fn warp(
        &self,
        forward: &Forward,
        sources: &[SourceView],
        colors: Buffer<[f32; 4]>,
    ) -> Result<Warped, GpuError> {
        let mut pass = Pass::new(&self.gpu, LABEL);
        let warped = self.record(&mut pass, forward, sources, colors)?;
        pass.submit();
        Ok(warped)
    }

    /// As [`Warper::warp`], as a part of a pass.
    ///
    /// # Errors
    /// Not enough memory.
    ///
    /// # Panics
    /// As [`Warper::warp`].
    pub fn record(
        &self,
        pass: &mut Pass,
        forward: &Forward,
        sources: &[SourceView],
        colors: Buffer<[f32; 4]>,
    ) -> Result<Warped, GpuError> {
        let surface = forward.surface().expect("warping needs a surface");
        assert!((1..=MAX_SOURCES).contains(&sources.len()), "warping needs one to {MAX_SOURCES} sources");
        let pixels = surface.camera.pixels();
        let mut seen = self.scratch(pixels)?;
        seen.sources = sources.len() as u32;
        let from = |s: &SourceView| (surface.camera.center() - s.camera.center()).extend(0.0).as_vec4().to_array();
        let centers: Vec<[f32; 4]> = sources.iter().map(from).collect();
        self.gpu.write(&seen.centers, 0, &centers);
        pass.relabel(LABEL);
        pass.clear(&seen.most_visible);
        let with_params =
            |(index, source): (usize, &SourceView)| (source.clone(), params(surface, source, index, &self.options));
        let used: Vec<_> = sources.iter().enumerate().map(with_params).collect();
        let all: Vec<_> = used.iter().map(|(_, params)| *params).collect();
        self.gpu.write(&seen.params, 0, &all);
        self.record_rounds(pass, surface, &used, &seen, &colors);
        let seen = Arc::new(seen);
        let (options, cameras) = (self.options, forward.cameras.clone());
        Ok(Warped { colors, seen, visible: options.visible, surface: surface.clone(), sources: used, options, cameras })
    }

    /// A dispatch for four sources where the device binds as many buffers, else for each.
    fn record_rounds(
        &self,
        pass: &mut Pass,
        surface: &Surface,
        sources: &[(SourceView, SourceParams)],
        seen: &Seen,
        warped: &Buffer<[f32; 4]>,
    ) {
        let four = self.gpu.binds(&WARP_FOUR);
        let (median_depth, intersections) = (&surface.median_depth, &surface.intersections);
        let (most_visible, all, seen) = (&seen.most_visible, &seen.params, &seen.visible);
        for round in rounds(sources, surface, &self.options, if four { FOUR } else { 1 }) {
            let [photo0, photo1, photo2, photo3] = round.sources.map(|source| &source.photo.texels);
            let [source_depth0, source_depth1, source_depth2, source_depth3] =
                round.sources.map(|source| &source.depth);
            let grid = tiles(round.params.size);
            if four {
                let buffers = WarpFourBindings {
                    sources: all,
                    median_depth,
                    intersections,
                    warped,
                    seen,
                    most_visible,
                    photo0,
                    source_depth0,
                    photo1,
                    source_depth1,
                    photo2,
                    source_depth2,
                    photo3,
                    source_depth3,
                };
                pass.grid(&buffers, &round.params, grid);
            } else {
                let buffers = WarpBindings {
                    sources: all,
                    median_depth,
                    intersections,
                    warped,
                    seen,
                    most_visible,
                    photo0,
                    source_depth0,
                };
                pass.grid(&buffers, &round.params, grid);
            }
        }
    }
}
