//! The Gaussian rasterizer: its passes and its memory.
//!
//! Forward: `project`, prefix sum of the tile counts, `tile_emit`, `tile_starts`, `tile_place`, `tile_sort`, `rasterize`, or
//! `rasterize_ellipsoids` for a look at single Gaussians. The blending order is exactly tile, then float32 view depth, then
//! Gaussian index, and nothing depends on the order in which threads run: the same input gives the same bits.
//! Backward: `rasterize_backward`, `sum_rows`, `project_backward`.
//!
//! With a surface ([`RasterView::surface`]) `planes` follows the projection, `rasterize_surface`, or `rasterize_surface_image`
//! without gradients, takes the place of `rasterize`, and `rasterize_surface_backward` and `planes_backward` join the backward pass.
//! For gradients by the camera ([`Forward::cameras`]) `camera_surface`, `camera_project` and `camera_planes` join it too, for the
//! statistics of densification ([`Forward::statistics`]) `densify_observe`.

mod backward;
mod camera;
mod dropout;
mod lists;
mod surface;
mod view;
mod workspace;

pub use backward::{RasterGradients, ScreenStatistics};
pub use camera::CameraGradients;
pub use dropout::{Dropout, iteration_seed};
pub use surface::{Surface, SurfaceOptions};
pub use view::{RasterView, Shape};
pub use workspace::Workspace;

use crate::camera::Camera;
use crate::gpu::pool::{Lease, Pool};
use crate::gpu::{Buffer, Gpu, GpuError, Pass, at_once};
use crate::scene::Splats;
use ibgs_shaders::bindings::{RasterizeBindings, RasterizeDepthBindings, RasterizeEllipsoidsBindings};
use ibgs_shaders::types::ViewUniforms;
use ibgs_shaders::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Whether a pass keeps what a backward pass needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Keep {
    /// The image alone.
    Image,
    /// Memory for gradients as well.
    Gradients,
}

/// Whether a pass makes certain that every tile intersection fits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Room {
    /// Waits for their number and repeats the pass with more room where they do not.
    Checked,
    /// Does not wait: where there are too many, those of the last Gaussians are lost. For timing, and for viewers that have
    /// rendered about the same view before.
    Assumed,
}

/// One forward pass: the image and what its backward pass needs.
#[derive(Clone, Debug)]
pub struct Forward {
    /// Image, `[H, W, 3]`.
    pub image: Buffer<f32>,
    /// Uniforms of the view.
    pub frame: ViewUniforms,
    /// Memory of the pass.
    pub workspace: Arc<Lease<Workspace>>,
    /// What the view's [`RasterView::surface`] asked for.
    surface: Option<Arc<Lease<Surface>>>,
    /// Where the backward passes of this view add the gradients by cameras; none where nobody asks for them.
    pub cameras: Option<CameraGradients>,
    /// Where its backward passes add the view for densification; none where it does not count.
    pub statistics: Option<ScreenStatistics>,
}

const LABEL: &str = "rasterize";

/// Rasterizes; owns the scratch memory.
#[derive(Debug)]
pub struct Rasterizer {
    gpu: Arc<Gpu>,
    pool: Arc<Pool<Workspace>>,
    surfaces: Arc<Pool<Surface>>,
    /// Intersections that new workspaces hold.
    capacity: AtomicU64,
}

impl Rasterizer {
    /// A rasterizer without any memory yet.
    pub fn new(gpu: Arc<Gpu>) -> Self {
        Self { gpu, pool: Arc::default(), surfaces: Arc::default(), capacity: AtomicU64::new(1 << 16) }
    }

    /// The GPU it works on.
    pub fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    /// Intersections that a pass can hold now.
    pub fn capacity(&self) -> u64 {
        self.capacity.load(Ordering::Relaxed)
    }

    /// Makes room for exactly as many intersections as [`capacity`](Self::capacity) returned.
    pub fn set_capacity(&self, capacity: u64) {
        self.capacity.store(capacity.min(self.gpu.binding_limit() / 16), Ordering::Relaxed);
    }

    /// Makes room for twice `needed` intersections, where there is not room for one and a half times as many already;
    /// as far as one binding reaches, if that is less.
    pub fn reserve(&self, needed: u64) {
        // The widest buffer of an intersection is one row of gradients, 16 bytes.
        let most = self.gpu.binding_limit() / 16;
        let wanted = (2 * needed + 1024).min(most.max(needed));
        if needed + needed / 2 > self.capacity() {
            self.capacity.store(wanted, Ordering::Relaxed);
        }
    }

    fn workspace(&self, count: usize, frame_tiles: usize, pixels: usize, rows: usize) -> Result<Workspace, GpuError> {
        let capacity = self.capacity() as usize;
        let Some(last) = self.pool.take() else {
            return Workspace::new(&self.gpu, count, capacity, frame_tiles, pixels, rows);
        };
        if last.fits(count, capacity, frame_tiles, pixels, rows) {
            return Ok(last);
        }
        // Any other free workspace is too small as well. The new one is also large enough for what this one was made
        // for, so that views of different shapes do not replace each other's.
        let (tiles, pixels) = (frame_tiles.max(last.tiles()), pixels.max(last.pixels()));
        let rows = rows.max(last.rows.len());
        drop(last);
        self.pool.clear();
        Workspace::new(&self.gpu, count, capacity, tiles, pixels, rows)
    }

    /// Values of a view's image.
    ///
    /// # Errors
    /// When the device cannot bind them at once.
    fn image_values(&self, camera: &Camera) -> Result<usize, GpuError> {
        let values = 3 * camera.pixels();
        self.gpu.check_size("image", 4 * values as u64)?;
        Ok(values)
    }

    /// Memory of its own for a view's image.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn image_memory(&self, camera: &Camera) -> Result<Buffer<f32>, GpuError> {
        self.gpu.transient("image", self.image_values(camera)?)
    }

    /// One forward pass into `image`, `[H, W, 3]`.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn forward(
        &self,
        splats: &Splats,
        view: &RasterView,
        keep: Keep,
        image: Buffer<f32>,
    ) -> Result<Forward, GpuError> {
        let mut pass = Pass::new(&self.gpu, LABEL);
        let forward = self.record(&mut pass, splats, view, keep, image)?;
        pass.submit();
        Ok(forward)
    }

    /// Records the forward pass of a view into `image`, `[H, W, 3]`.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn record(
        &self,
        pass: &mut Pass,
        splats: &Splats,
        view: &RasterView,
        keep: Keep,
        image: Buffer<f32>,
    ) -> Result<Forward, GpuError> {
        let rows = match (keep, view.surface) {
            (Keep::Image, _) => 0,
            (Keep::Gradients, None) => 3,
            (Keep::Gradients, Some(_)) => 4,
        };
        let ws = self.leased_workspace(splats, view, rows)?;
        let frame = view.frame(splats, ws.capacity);
        let surface = view.surface.map(|o| self.leased_surface(splats.count, view, o, keep)).transpose()?;
        pass.relabel(LABEL);
        // Before the dispatches, which share a compute pass as long as nothing comes between them.
        if let Some(s) = &surface {
            s.clear_gradients(pass);
        }
        lists::record_lists(pass, &ws, splats, &frame);
        let grid = tile_grid(&frame);
        let Workspace { projected, sorted_gaussians, tile_ranges, .. } = &ws;
        match &surface {
            None if view.shape == Shape::Ellipsoids => {
                let blend = RasterizeEllipsoidsBindings { projected, sorted_gaussians, tile_ranges, image: &image };
                pass.grid(&blend, &frame, grid);
            }
            None => {
                let (image, final_t, last_entry) = (&image, &ws.final_t, &ws.last_entry);
                let blend = RasterizeBindings { projected, sorted_gaussians, tile_ranges, image, final_t, last_entry };
                pass.grid(&blend, &frame, grid);
            }
            Some(s) => {
                surface::record_planes(pass, splats, &s.planes, &frame);
                s.record(pass, (&ws, sorted_gaussians), &image, grid);
            }
        }
        Ok(Forward { image, frame, workspace: Arc::new(self.pool.lease(ws)), surface, cameras: None, statistics: None })
    }

    fn leased_workspace(&self, splats: &Splats, view: &RasterView, rows: usize) -> Result<Workspace, GpuError> {
        let Camera { width, height, .. } = view.camera;
        let tiles = width.div_ceil(TILE) as usize * height.div_ceil(TILE) as usize;
        self.image_values(&view.camera)?;
        self.workspace(splats.count, tiles, view.camera.pixels(), rows)
    }

    /// Median depth of a view, `[H * W]`, 0 where nothing is met.
    ///
    /// # Errors
    /// Not enough memory, or the device is lost.
    ///
    /// # Panics
    /// When the view asks for no surface: a bug of ours.
    pub fn depth_map(&self, splats: &Splats, view: &RasterView, room: Room) -> Result<Buffer<f32>, GpuError> {
        at_once(self.depth_map_in(splats, view, room))
    }

    /// As [`Rasterizer::depth_map`] with [`Room::Checked`], for browsers.
    ///
    /// # Errors
    /// Not enough memory, or the device is lost.
    ///
    /// # Panics
    /// As [`Rasterizer::depth_map`].
    pub async fn depth_map_async(&self, splats: &Splats, view: &RasterView) -> Result<Buffer<f32>, GpuError> {
        self.depth_map_in(splats, view, Room::Checked).await
    }

    async fn depth_map_in(&self, splats: &Splats, view: &RasterView, room: Room) -> Result<Buffer<f32>, GpuError> {
        let gpu = &*self.gpu;
        let options = view.surface.expect("a depth map needs the surface's options");
        // Colours are not looked at.
        let view = RasterView { sh_degree: 0, ..*view };
        let depth = gpu.allocate("median depth", view.camera.pixels())?;
        let planes = gpu.allocate("planes", splats.count)?;
        loop {
            let ws = self.leased_workspace(splats, &view, 0)?;
            let frame = view.frame(splats, ws.capacity);
            let mut pass = Pass::new(gpu, "depth map");
            lists::record_lists(&mut pass, &ws, splats, &frame);
            surface::record_planes(&mut pass, splats, &planes, &frame);
            let blend = RasterizeDepthBindings {
                projected: &ws.projected,
                planes: &planes,
                sorted_gaussians: &ws.sorted_gaussians,
                tile_ranges: &ws.tile_ranges,
                median_depth: &depth,
            };
            let kernel = options.kernel([&RASTERIZE_DEPTH, &RASTERIZE_DEPTH_DEEP]);
            pass.grid_of(kernel, &blend, &options.frame(&view), tile_grid(&frame));
            pass.submit();
            let ws = self.pool.lease(ws);
            if room == Room::Assumed {
                return Ok(depth);
            }
            let needed = gpu.read_async(&ws.total, 1).await?[0];
            if self.fitted(&frame, needed.into()) {
                return Ok(depth);
            }
        }
    }

    /// Whether every intersection of a pass fitted; makes room otherwise. Waits for the GPU.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn had_room(&self, forward: &Forward) -> Result<bool, GpuError> {
        let total = at_once(self.gpu.read_async(&forward.workspace.total, 1))?[0];
        Ok(self.fitted(&forward.frame, total.into()))
    }

    /// Whether `needed` intersections fitted; if not, the next pass has room for them.
    pub(crate) fn fitted(&self, frame: &ViewUniforms, needed: u64) -> bool {
        let fitted = needed <= u64::from(frame.capacity);
        if !fitted {
            self.reserve(needed);
        }
        fitted
    }

    /// Image `[H, W, 3]` of the model from a view, waiting for the exact intersection count.
    ///
    /// # Errors
    /// Not enough memory, or the device is lost.
    pub fn render(&self, splats: &Splats, view: &RasterView) -> Result<Buffer<f32>, GpuError> {
        Ok(self.surface(splats, view)?.image)
    }

    /// Image and, where the view asks for one, surface of the model, waiting for the exact intersection count.
    ///
    /// # Errors
    /// Not enough memory, or the device is lost.
    pub fn surface(&self, splats: &Splats, view: &RasterView) -> Result<Forward, GpuError> {
        loop {
            let image = self.image_memory(&view.camera)?;
            let forward = self.forward(splats, view, Keep::Image, image)?;
            if self.had_room(&forward)? {
                return Ok(forward);
            }
        }
    }

    /// Tile intersections of a view.
    ///
    /// # Errors
    /// Not enough memory, or the device is lost.
    pub fn count_intersections(&self, splats: &Splats, view: &RasterView) -> Result<u64, GpuError> {
        self.surface(splats, view)?.intersections(&self.gpu)
    }
}

impl Forward {
    /// The surface, where the view asked for one.
    pub fn surface(&self) -> Option<&Arc<Lease<Surface>>> {
        self.surface.as_ref()
    }

    pub(crate) fn pixels(&self) -> u32 {
        self.frame.size[0] * self.frame.size[1]
    }

    /// The buffer with the transmittance behind the last contributors, and where in it that of the first pixel lies.
    pub fn transmittance(&self) -> (&Buffer<f32>, u32) {
        match &self.surface {
            // With the normals, so that the kernel binds one buffer less.
            Some(surface) if surface.v.is_none() => (&surface.normal_map, 3 * self.pixels()),
            _ => (&self.workspace.final_t, 0),
        }
    }

    /// How many tile intersections the pass counted; waits for the GPU.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn intersections(&self, gpu: &Gpu) -> Result<u64, GpuError> {
        Ok(u64::from(gpu.read(&self.workspace.total, 1)?[0]))
    }
}

/// Workgroups of a kernel that has one a tile.
fn tile_grid(frame: &ViewUniforms) -> [u32; 3] {
    [frame.size[0].div_ceil(TILE), frame.size[1].div_ceil(TILE), 1]
}
