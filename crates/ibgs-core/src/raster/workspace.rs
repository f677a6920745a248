//! Scratch memory of one rasterizer pass, reused from pass to pass.

use crate::gpu::scan::Scan;
use crate::gpu::sort::Sort;
use crate::gpu::{Buffer, Gpu, GpuError};

/// Buffers between the kernels; those of the forward pass live on until the backward pass has read them.
#[derive(Debug)]
pub struct Workspace {
    /// Three vec4 a Gaussian, see `project.wgsl`.
    pub projected: Buffer,
    /// Tiles that each Gaussian touches.
    pub tile_counts: Buffer,
    /// The number of Gaussians, for the depth sort.
    pub count: Buffer,
    /// Keys: depth; values: Gaussians in depth order.
    pub depth_sort: Sort,
    /// Tile counts in depth order.
    pub counts_by_depth: Buffer,
    /// Their exclusive prefix sum: where each Gaussian's intersections start.
    pub offsets: Buffer,
    /// Intersections in all.
    pub total: Buffer,
    pub(super) scan: Scan,
    /// Keys: tile; values: emission indices in tile order.
    pub tile_sort: Sort,
    /// Gaussian of each emission index.
    pub isect_to_gaussian: Buffer,
    /// (start, end) a tile.
    pub tile_ranges: Buffer,
    /// Transmittance behind the last contributor.
    pub final_t: Buffer,
    /// List entries walked up to the last contributor; not written by `rasterize_surface_image`.
    pub last_entry: Buffer,
    /// Gradient rows by emission index: colour and opacity, screen position, covariance, plane. As many as asked for:
    /// none, three, or four with a surface.
    pub rows: Vec<Buffer>,
    gaussians: usize,
    tiles: usize,
    pixels: usize,
}

impl Workspace {
    pub(super) fn new(
        gpu: &Gpu,
        count: usize,
        capacity: usize,
        tiles: usize,
        pixels: usize,
        rows: usize,
    ) -> Result<Self, GpuError> {
        let n = count.max(1);
        let words = |what, count: usize| gpu.allocate(what, 4 * count.max(1) as u64);
        let row = |_| gpu.allocate("intersection gradients", 16 * capacity as u64);
        let rows = (0..rows).map(row).collect::<Result<_, _>>()?;
        Ok(Self {
            projected: words("projected Gaussians", 12 * n)?,
            tile_counts: words("tile counts", n)?,
            count: words("Gaussian count", 1)?,
            depth_sort: Sort::new(gpu, n)?,
            counts_by_depth: words("tile counts", n)?,
            offsets: words("intersection offsets", n)?,
            total: words("intersection count", 1)?,
            scan: Scan::new(gpu, n)?,
            tile_sort: Sort::new(gpu, capacity)?,
            isect_to_gaussian: words("intersections", capacity)?,
            tile_ranges: words("tile ranges", 2 * tiles)?,
            final_t: words("transmittance", pixels)?,
            last_entry: words("last contributors", pixels)?,
            rows,
            gaussians: n,
            tiles,
            pixels,
        })
    }

    /// Whether a pass of this size can use it without wasting more than half of it.
    pub(super) fn fits(&self, count: usize, capacity: usize, tiles: usize, pixels: usize, rows: usize) -> bool {
        self.gaussians >= count
            && self.gaussians <= 2 * count.max(1024)
            && self.isects() >= capacity
            && self.tiles >= tiles
            && self.pixels >= pixels
            && self.rows.len() >= rows
    }

    /// Tiles it holds.
    pub(super) fn tiles(&self) -> usize {
        self.tiles
    }

    /// Pixels it holds.
    pub(super) fn pixels(&self) -> usize {
        self.pixels
    }

    /// Intersections it holds.
    pub fn isects(&self) -> usize {
        self.tile_sort.capacity()
    }

    /// The Gaussian of each sorted list entry: lies in the key buffer that the tile sort left free.
    pub(super) fn sorted_gaussians(&self, sorted: usize) -> &Buffer {
        &self.tile_sort.keys[1 - sorted]
    }
}
