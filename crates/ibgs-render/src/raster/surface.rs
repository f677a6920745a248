//! What a rasterizer pass with a surface gives beside the colour (method.md section 3), and the gradients by it.

use super::workspace::Workspace;
use super::{Keep, RasterView, Rasterizer};
use crate::camera::Camera;
use crate::gpu::pool::Lease;
use crate::gpu::{Buffer, Gpu, GpuError, Pass};
use crate::scene::{PerGaussian, Splats};
use ibgs_shaders::bindings::{
    PlanesBindings, RasterizeSurfaceBindings, RasterizeSurfaceImageBindings, ShortestAxisBindings,
};
use ibgs_shaders::types::{SurfaceUniforms, ViewUniforms};
use ibgs_shaders::{
    Kernel, RASTERIZE_SURFACE, RASTERIZE_SURFACE_DEEP, RASTERIZE_SURFACE_IMAGE, RASTERIZE_SURFACE_IMAGE_DEEP, TILE,
};
use std::sync::Arc;

/// How the surface is found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceOptions {
    /// Median intersections a pixel, K: even, 2 to 8.
    pub intersections: u32,
    /// Where a pixel's ray passes, in pixels from its upper left corner: 0.5, its centre. The published code has 0, half a
    /// pixel from where it splats.
    pub ray_offset: f64,
}

impl Default for SurfaceOptions {
    fn default() -> Self {
        Self { intersections: 4, ray_offset: 0.5 }
    }
}

impl SurfaceOptions {
    /// Principal point in coordinates in which the pixel with index x lies at x.
    pub fn principal(&self, camera: &Camera) -> [f32; 2] {
        (camera.principal - self.ray_offset).as_vec2().to_array()
    }

    /// Of two kernels the one whose registers hold so many intersections: at most four, or at most eight.
    pub(super) fn kernel(&self, [few, many]: [&'static Kernel; 2]) -> &'static Kernel {
        if self.intersections <= 4 { few } else { many }
    }

    pub(super) fn frame(&self, view: &RasterView) -> SurfaceUniforms {
        let c = &view.camera;
        SurfaceUniforms {
            background: view.background,
            intersections: self.intersections,
            focal: c.focal.as_vec2().to_array(),
            principal: self.principal(c),
            size: [c.width, c.height],
            tiles: [c.width.div_ceil(TILE), c.height.div_ceil(TILE)],
        }
    }
}

/// The surface of one pass; P pixels row by row.
#[derive(Debug)]
pub struct Surface {
    /// (n_c, D_c) of each Gaussian.
    pub(super) planes: Buffer<[f32; 4]>,
    /// Sum of w n_c, camera space, not normalised, `[P, 3]`. Without gradients followed by [`Forward::transmittance`](super::Forward),
    /// `[P]`.
    pub normal_map: Buffer<f32>,
    /// Median depth, `[P]`, 0 where nothing is met.
    pub median_depth: Buffer<f32>,
    /// (view depth, weight) of the median intersections front to back, `[K, P]`; weight 0 where there is none.
    pub intersections: Buffer<[f32; 2]>,
    /// Gradients of the loss by the normal map, the median depth and the intersections. Zero after the forward pass; whoever uses the
    /// surface adds to them before the rasterizer's own backward pass runs. Empty without gradients.
    pub v: Option<SurfaceGradients>,
    /// The target camera.
    pub camera: Camera,
    /// How it was found.
    pub options: SurfaceOptions,
    pub(super) frame: SurfaceUniforms,
    gaussians: usize,
    pixels: usize,
    values: usize,
}

/// Gradients by a [`Surface`].
#[derive(Debug)]
pub struct SurfaceGradients {
    /// By the normal map, `[P, 3]`.
    pub normal_map: Buffer<f32>,
    /// By the median depth, `[P]`.
    pub median_depth: Buffer<f32>,
    /// By the intersections' depths and weights, `[K, P]`.
    pub intersections: Buffer<[f32; 2]>,
    /// Entries of the intersections in the tile's list, `[K, P]`.
    pub(super) entries: Buffer<u32>,
}

impl Surface {
    fn new(gpu: &Gpu, count: usize, view: &RasterView, options: SurfaceOptions, keep: Keep) -> Result<Self, GpuError> {
        let p = view.camera.pixels();
        let values = p * options.intersections as usize;
        let by = || {
            Ok(SurfaceGradients {
                normal_map: gpu.allocate("normal gradients", 3 * p)?,
                median_depth: gpu.allocate("depth gradients", p)?,
                intersections: gpu.allocate("intersection gradients", values)?,
                entries: gpu.allocate("median intersections", values)?,
            })
        };
        Ok(Self {
            planes: gpu.allocate("planes", count)?,
            normal_map: gpu.allocate("normal map", if keep == Keep::Image { 4 * p } else { 3 * p })?,
            median_depth: gpu.allocate("median depth", p)?,
            intersections: gpu.allocate("median intersections", values)?,
            v: (keep == Keep::Gradients).then(by).transpose()?,
            camera: view.camera,
            options,
            frame: options.frame(view),
            gaussians: count,
            pixels: p,
            values,
        })
    }

    fn fits(&self, count: usize, values: usize, pixels: usize, keep: Keep) -> bool {
        self.gaussians >= count
            && self.gaussians <= 2 * count.max(1024)
            && self.values >= values
            && self.pixels >= pixels
            && (self.v.is_some() || keep == Keep::Image)
    }

    /// Records the blending of `image` with the surface.
    pub(super) fn record(
        &self,
        pass: &mut Pass,
        (ws, sorted_gaussians): (&Workspace, &Buffer<u32>),
        image: &Buffer<f32>,
        grid: [u32; 3],
    ) {
        let Surface { planes, normal_map, median_depth, intersections, .. } = self;
        let Workspace { projected, tile_ranges, final_t, last_entry, .. } = ws;
        match &self.v {
            Some(v) => {
                let blend = RasterizeSurfaceBindings {
                    projected,
                    planes,
                    sorted_gaussians,
                    tile_ranges,
                    image,
                    final_t,
                    last_entry,
                    normal_map,
                    median_depth,
                    intersections,
                    intersection_entries: &v.entries,
                };
                let kernel = self.options.kernel([&RASTERIZE_SURFACE, &RASTERIZE_SURFACE_DEEP]);
                pass.grid_of(kernel, &blend, &self.frame, grid);
            }
            None => {
                let blend = RasterizeSurfaceImageBindings {
                    projected,
                    planes,
                    sorted_gaussians,
                    tile_ranges,
                    image,
                    normal_map,
                    median_depth,
                    intersections,
                };
                let kernel = self.options.kernel([&RASTERIZE_SURFACE_IMAGE, &RASTERIZE_SURFACE_IMAGE_DEEP]);
                pass.grid_of(kernel, &blend, &self.frame, grid);
            }
        }
    }

    pub(super) fn clear_gradients(&self, pass: &mut Pass) {
        if let Some(v) = &self.v {
            pass.clear(&v.normal_map);
            pass.clear(&v.median_depth);
            pass.clear(&v.intersections);
        }
    }
}

pub(super) fn record_planes(pass: &mut Pass, splats: &Splats, planes: &Buffer<[f32; 4]>, frame: &ViewUniforms) {
    let PerGaussian { means, normals, offsets: plane_offsets, .. } = &splats.parameters;
    pass.linear(&PlanesBindings { means, normals, plane_offsets, planes }, frame, splats.count);
}

impl Rasterizer {
    /// Sets every plane's normal to its Gaussian's shortest axis and its offset to 0 (method.md section 1), in place.
    pub fn shape_normals(&self, splats: &Splats) {
        let PerGaussian { log_scales, normals, offsets: plane_offsets, .. } = &splats.parameters;
        let rotations = &splats.rotations();
        let frame = ViewUniforms { count: splats.count as u32, ..ViewUniforms::default() };
        let mut pass = Pass::new(&self.gpu, "shape normals");
        let buffers = ShortestAxisBindings { rotations, log_scales, normals, plane_offsets };
        pass.linear(&buffers, &frame, splats.count);
        pass.submit();
    }

    pub(super) fn leased_surface(
        &self,
        count: usize,
        view: &RasterView,
        options: SurfaceOptions,
        keep: Keep,
    ) -> Result<Arc<Lease<Surface>>, GpuError> {
        let pixels = view.camera.width as usize * view.camera.height as usize;
        let free =
            self.surfaces.take().filter(|s| s.fits(count, pixels * options.intersections as usize, pixels, keep));
        let surface = match free {
            Some(free) => Surface { camera: view.camera, options, frame: options.frame(view), ..free },
            None => {
                // Whatever else is free is too small as well.
                self.surfaces.clear();
                Surface::new(&self.gpu, count, view, options, keep)?
            }
        };
        Ok(Arc::new(self.surfaces.lease(surface)))
    }
}
