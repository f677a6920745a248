//! Scratch memory of one rasterizer pass, reused from pass to pass.

use crate::gpu::scan::Scan;
use crate::gpu::{Buffer, Gpu, GpuError};

/// Buffers between the kernels; those of the forward pass live on until the backward pass has read them.
#[derive(Debug)]
pub struct Workspace {
    /// Three vec4 a Gaussian, see `project.wgsl`.
    pub projected: Buffer<[f32; 4]>,
    /// Tiles that each Gaussian touches; after `tile_emit` those that it has found.
    pub tile_counts: Buffer<u32>,
    /// Their exclusive prefix sum: where each Gaussian's intersections start.
    pub offsets: Buffer<u32>,
    /// Intersections in all.
    pub total: Buffer<u32>,
    pub(super) scan: Scan,
    /// Gaussian of each emission index.
    pub isect_to_gaussian: Buffer<u32>,
    /// Key (the bits of the depth) and emission index of each list entry, before the sort.
    pub(super) list: Buffer<[u32; 2]>,
    /// Gaussian of each list entry; before the sort the tile of each emission index.
    pub sorted_gaussians: Buffer<u32>,
    /// Emission index of each list entry; before the sort the place of each emission index in its tile's list.
    pub sorted_isects: Buffer<u32>,
    /// Entries of each tile's list while they are counted, then zeros; one list more, of the tile that does not exist.
    pub(super) list_lengths: Buffer<u32>,
    /// (start, end) of the same; then the tiles in the order in which workgroups take them.
    pub tile_ranges: Buffer<u32>,
    /// Transmittance behind the last contributor; not written by `rasterize_surface_image`.
    pub final_t: Buffer<f32>,
    /// List entries walked up to the last contributor; not written by `rasterize_surface_image`.
    pub last_entry: Buffer<u32>,
    /// Gradient rows by emission index: colour and opacity, screen position, covariance, plane. As many as asked for:
    /// none, three, or four with a surface.
    pub rows: Vec<Buffer<[f32; 4]>>,
    gaussians: usize,
    /// Intersections it holds.
    pub(super) capacity: usize,
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
        let words = |what, count: usize| gpu.allocate::<u32>(what, count.max(1));
        let row = |_| gpu.allocate("intersection gradients", capacity);
        let rows = (0..rows).map(row).collect::<Result<_, _>>()?;
        Ok(Self {
            projected: gpu.allocate("projected Gaussians", 3 * n)?,
            tile_counts: words("tile counts", n)?,
            offsets: words("intersection offsets", n)?,
            total: words("intersection count", 1)?,
            scan: Scan::new(gpu, n)?,
            isect_to_gaussian: words("intersections", capacity)?,
            list: gpu.allocate("tile lists", capacity)?,
            sorted_gaussians: words("tile lists", capacity)?,
            sorted_isects: words("tile lists", capacity)?,
            list_lengths: words("tile ranges", tiles + 1)?,
            tile_ranges: words("tile ranges", 2 * (tiles + 1) + tiles)?,
            final_t: gpu.allocate("transmittance", pixels.max(1))?,
            last_entry: words("last contributors", pixels)?,
            rows,
            gaussians: n,
            capacity,
            tiles,
            pixels,
        })
    }

    /// Whether a pass of this size can use it without wasting more than half of it.
    pub(super) fn fits(&self, count: usize, capacity: usize, tiles: usize, pixels: usize, rows: usize) -> bool {
        self.gaussians >= count
            && self.gaussians <= 2 * count.max(1024)
            && self.capacity >= capacity
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
}
