//! The normal loss (method.md section 7): the normals of the median depth against the normal map, as a burn autodiff
//! operation whose gradients go into buffers beside the graph.

use super::{Loss, LossInputs};
use crate::autodiff::unary;
use crate::tensor::{bind, empty_like};
use burn::tensor::Tensor;
use burn_cubecl::tensor::CubeTensor;
use ibgs_core::camera::Camera;
use ibgs_core::gpu::pool::{Lease, Pool};
use ibgs_core::gpu::{Buffer, Gpu, GpuError, Pass};
use ibgs_core::raster::Surface;
use ibgs_core::sources::DevicePhoto;
use ibgs_shaders::TILE;
use ibgs_shaders::bindings::{DepthNormalsBindings, LossMeanBindings, NormalLossBackwardBindings, NormalLossBindings};
use ibgs_shaders::types::{MeanParams, SurfaceParams};
use std::sync::Arc;

/// The surface that a forward pass met, and where the gradients by it are gathered. Pixels row by row, P of them; four
/// wgpu buffers of their own. Cloning shares them.
#[derive(Clone, Debug)]
pub struct SurfaceBuffers {
    /// `[P]` f32: median depth, 0 where nothing was met, never negative.
    pub depth: Buffer<f32>,
    /// `[P, 3]` f32: normal map in camera space, not normalised.
    pub normal: Buffer<f32>,
    /// `[P]` f32: gradient by the depth; losses add to it.
    pub v_depth: Buffer<f32>,
    /// `[P, 3]` f32: gradient by the normal map; losses add to it.
    pub v_normal: Buffer<f32>,
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Focal lengths in pixels.
    pub focal: [f32; 2],
    /// Principal point minus one half: the pixel with index x lies at x.
    pub principal: [f32; 2],
}

impl SurfaceBuffers {
    /// Zeroed buffers for a camera's image.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn new(gpu: &Gpu, camera: &Camera) -> Result<Self, GpuError> {
        let pixels = camera.pixels();
        Ok(Self {
            depth: gpu.allocate("median depth", pixels)?,
            normal: gpu.allocate("normal map", 3 * pixels)?,
            v_depth: gpu.allocate("gradient of the median depth", pixels)?,
            v_normal: gpu.allocate("gradient of the normal map", 3 * pixels)?,
            size: [camera.width, camera.height],
            focal: camera.focal.as_vec2().to_array(),
            principal: (camera.principal - 0.5).as_vec2().to_array(),
        })
    }

    /// Those of a surface that keeps gradients; they share its memory.
    ///
    /// # Panics
    /// When it keeps none: a bug of ours.
    pub fn of(surface: &Surface) -> Self {
        let v = surface.v.as_ref().expect("a tracked surface has gradients");
        Self {
            depth: surface.median_depth.clone(),
            normal: surface.normal_map.clone(),
            v_depth: v.median_depth.clone(),
            v_normal: v.normal_map.clone(),
            size: [surface.camera.width, surface.camera.height],
            focal: surface.camera.focal.as_vec2().to_array(),
            principal: surface.options.principal(&surface.camera),
        }
    }

    fn params(&self, weight: f32) -> SurfaceParams {
        SurfaceParams { size: self.size, focal: self.focal, principal: self.principal, weight, pad: 0.0 }
    }

    fn tiles(&self) -> [u32; 3] {
        [self.size[0].div_ceil(TILE), self.size[1].div_ceil(TILE), 1]
    }

    /// Records the depth normals Nd of method.md section 3 into `out`, `[P, 3]` f32 in camera space: unit length, or
    /// zero on the one-pixel border and where neighbours met nothing. For pictures; the loss does not need them.
    pub fn record_depth_normals(&self, pass: &mut Pass, out: &Buffer<f32>) {
        let buffers = DepthNormalsBindings { depth: &self.depth, depth_normals: out };
        pass.grid(&buffers, &self.params(0.0), self.tiles());
    }
}

/// Scratch memory of one image size.
#[derive(Debug)]
struct Scratch {
    partials: Buffer<[f32; 2]>,
    stats: Buffer<f32>,
    groups: usize,
}

/// `weight (0.4 mean_p sum_c |Nd - N| + 0.6 mean_p (1 - Nd . N))` over all pixels, of which those that the photo masks add
/// nothing to the sums; owns its scratch memory.
#[derive(Debug)]
pub struct NormalLoss {
    gpu: Arc<Gpu>,
    pool: Arc<Pool<Scratch>>,
    /// Weight of the loss.
    pub weight: f32,
}

impl NormalLoss {
    /// A loss with this weight.
    pub fn new(gpu: Arc<Gpu>, weight: f32) -> Self {
        Self { gpu, pool: Arc::default(), weight }
    }

    fn scratch(&self, groups: usize) -> Result<Lease<Scratch>, GpuError> {
        let make = || {
            Ok(Scratch {
                partials: self.gpu.allocate("normal loss sums", groups)?,
                stats: self.gpu.allocate("normal loss statistics", 2)?,
                groups,
            })
        };
        self.pool.lease_or(|scratch| scratch.groups >= groups, make)
    }

    fn forward(
        &self,
        like: &CubeTensor,
        surface: &SurfaceBuffers,
        photo: &DevicePhoto,
    ) -> Result<CubeTensor, GpuError> {
        let gpu = &*self.gpu;
        let tiles = surface.tiles();
        let groups = tiles[0] * tiles[1];
        let scratch = self.scratch(groups as usize)?;
        let loss = empty_like(like, &[1]);
        let bound = bind(&loss);
        let mut pass = Pass::new(gpu, "normal loss");
        let (SurfaceBuffers { depth, normal, .. }, Scratch { partials, stats, .. }) = (surface, &*scratch);
        let buffers = NormalLossBindings { depth, normal, photo: &photo.texels, partials };
        pass.grid(&buffers, &surface.params(self.weight), tiles);
        let mean = MeanParams { count: groups, weight: self.weight };
        pass.groups(&LossMeanBindings { partials, loss: &bound, stats }, &mean, 1);
        pass.submit();
        Ok(loss)
    }

    /// Loss `[1]` of the surface behind a tracked image; masked pixels of the photo have no part in it. The image only places the loss in the graph: it gets no
    /// gradient from here, but its maker runs its backward pass after this one and finds `v_depth` and
    /// `v_normal` complete.
    ///
    /// # Errors
    /// Not enough memory.
    ///
    /// # Panics
    /// When the image is not on the autodiff graph, or the photo has another size: bugs of ours.
    pub fn tracked(
        &self,
        image: &Tensor<3>,
        surface: &SurfaceBuffers,
        photo: &DevicePhoto,
    ) -> Result<Tensor<1>, GpuError> {
        assert_eq!(surface.size, photo.size, "surface and photo differ in size");
        let (gpu, params) = (self.gpu.clone(), surface.params(self.weight));
        let (surface, photo) = (surface.clone(), photo.clone());
        unary(image.clone(), |image| {
            let loss = self.forward(&image, &surface, &photo)?;
            // The gradients go into the surface's own buffers: the image gets none.
            let rule = move |v_loss: &CubeTensor| {
                let upstream = bind(v_loss);
                let mut pass = Pass::new(&gpu, "normal loss backward");
                let SurfaceBuffers { depth, normal, v_depth, v_normal, .. } = &surface;
                let (photo, v_loss) = (&photo.texels, &upstream);
                let buffers = NormalLossBackwardBindings { depth, normal, photo, v_loss, v_depth, v_normal };
                pass.grid(&buffers, &params, surface.tiles());
                pass.submit();
                None
            };
            Ok((loss, rule))
        })
    }
}

impl Loss for NormalLoss {
    fn uses_burn(&self) -> bool {
        false
    }

    fn of(&self, inputs: &LossInputs<'_>) -> Result<Option<Tensor<1>>, GpuError> {
        let counts = inputs.schedule.normal_loss_at(inputs.iteration) && self.weight > 0.0;
        let surface = inputs.surface.filter(|_| counts).map(SurfaceBuffers::of);
        surface.map(|surface| self.tracked(inputs.image, &surface, inputs.target)).transpose()
    }
}
