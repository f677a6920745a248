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
use ibgs_core::raster::{CameraGradients, Surface};
use ibgs_core::sources::DevicePhoto;
use ibgs_shaders::bindings::{
    DepthNormalsBindings, LossMeanBindings, NormalLossBackwardBindings, NormalLossBindings, NormalLossCameraBindings,
};
use ibgs_shaders::types::{MeanParams, SurfaceParams};
use ibgs_shaders::{CAMERA_GROUPS, TILE};
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
    /// Gradients by cameras; losses add that by the lens to the target's. None where nobody asks for them.
    pub cameras: Option<CameraGradients>,
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
            cameras: None,
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
            cameras: None,
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
                if let Some(cameras) = &surface.cameras {
                    let partials = cameras.partials();
                    let buffers = NormalLossCameraBindings { depth, normal, photo, v_loss, partials };
                    pass.groups(&buffers, &params, CAMERA_GROUPS as usize);
                    cameras.record_target(&mut pass);
                }
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
        let of = |surface| SurfaceBuffers { cameras: inputs.cameras.cloned(), ..SurfaceBuffers::of(surface) };
        let surface = inputs.surface.filter(|_| counts).map(of);
        surface.map(|surface| self.tracked(inputs.image, &surface, inputs.target)).transpose()
    }
}

/// Against the twins, forward and backward.
#[cfg(test)]
mod kernels {
    use super::{CameraGradients, NormalLoss, SurfaceBuffers};
    use crate::tensor::{device, values};
    use burn::tensor::{Tensor, TensorData};
    use ibgs_core::camera::Camera;
    use ibgs_core::camera_change::CameraChange;
    use ibgs_core::dataset::Photo;
    use ibgs_core::gpu::Pass;
    use ibgs_core::sources::DevicePhoto;
    use ibgs_reference::gpu::gpu;
    use ibgs_reference::normal_loss::{Surface, depth_normals, normal_loss, normal_loss_backward};
    use ibgs_reference::random_scene::{exact, random_camera, random_image};
    use ibgs_reference::relative_error;

    const WEIGHT: f64 = 0.03;
    /// What stands in the gradient buffers before.
    const BEFORE: f32 = 0.0625;

    struct OnGpu {
        loss: f64,
        v_depth: Vec<f64>,
        v_normal: Vec<f64>,
        /// By the target's camera and a source's.
        cameras: Vec<CameraChange>,
    }

    /// Loss and gradients on the GPU; the upstream gradient is 3. The gradients are what was added to `before`.
    fn on_gpu(seen: Surface, depth: &[f64], normal: &[[f64; 3]], before: f32) -> OnGpu {
        let (gpu, camera) = (gpu(), seen.camera);
        let rgba = seen.valid.iter().flat_map(|valid| [7, 7, 7, if *valid { 128 } else { 127 }]).collect();
        let photo = DevicePhoto::upload(&gpu, &Photo { width: camera.width, height: camera.height, rgba }).unwrap();
        let narrow = |v: &[f64]| -> Vec<f32> { v.iter().map(|x| *x as f32).collect() };
        let surface = SurfaceBuffers {
            depth: gpu.upload("depth", &narrow(depth)).unwrap(),
            normal: gpu.upload("normal", &narrow(normal.as_flattened())).unwrap(),
            v_depth: gpu.upload("v_depth", &vec![before; depth.len()]).unwrap(),
            v_normal: gpu.upload("v_normal", &vec![before; 3 * depth.len()]).unwrap(),
            cameras: Some(CameraGradients::new(&gpu, 1).unwrap()),
            ..SurfaceBuffers::new(&gpu, camera).unwrap()
        };
        let pixels = depth.len();
        let shape = [camera.height as usize, camera.width as usize, 3];
        let image = Tensor::<3>::from_data(TensorData::new(vec![0.5f32; 3 * pixels], shape), device(&gpu).unwrap());
        let leaf = image.autodiff().require_grad();
        let produced = leaf.clone() * 2.0;
        let loss = NormalLoss::new(gpu.clone(), WEIGHT as f32).tracked(&produced, &surface, &photo).unwrap();
        let mut grads = (loss.clone() * 3.0 + produced.sum()).backward();
        let by_image = values(leaf.grad_remove(&mut grads).unwrap());
        assert!(by_image.iter().all(|v| *v == 2.0), "the image has no gradient from the normal loss");
        let read = |buffer, count| -> Vec<f64> {
            gpu.read::<f32>(buffer, count).unwrap().into_iter().map(f64::from).collect()
        };
        OnGpu {
            loss: values(loss.inner())[0],
            v_depth: read(&surface.v_depth, pixels),
            v_normal: read(&surface.v_normal, 3 * pixels),
            cameras: surface.cameras.unwrap().read(&gpu).unwrap(),
        }
    }

    /// A wavy surface with holes where nothing was met, and normals of every length.
    fn surface(camera: &Camera, seed: u64, holes: bool) -> (Vec<f64>, Vec<[f64; 3]>) {
        let noise = random_image(camera.width, camera.height, 0.0, 1.0, seed);
        let depth = |(i, n): (usize, &[f64; 3])| {
            let (x, y) = ((i as u32 % camera.width) as f64, (i as u32 / camera.width) as f64);
            let hole = holes && n[2] < 0.15;
            if hole { 0.0 } else { exact(3.0 + (0.2 * x).sin() + 0.05 * y + 0.02 * n[0]) }
        };
        let depth = noise.iter().enumerate().map(depth).collect();
        (depth, random_image(camera.width, camera.height, -1.0, 1.0, seed + 1))
    }

    #[test]
    fn loss_and_gradients_follow_the_twin_at_every_size() {
        for (seed, (width, height)) in (0..).zip([(1, 1), (2, 5), (3, 3), (13, 9), (16, 16), (33, 17), (70, 50)]) {
            let camera = random_camera(width, height, seed);
            let (depth, normal) = surface(&camera, seed, seed % 2 == 1);
            // Every other size has a mask.
            let valid: Vec<bool> = (0..depth.len()).map(|i| seed % 2 == 0 || i % 5 != 1).collect();
            let seen = Surface { camera: &camera, valid: &valid };
            let ours = on_gpu(seen, &depth, &normal, 0.0);
            let what = format!("{width} x {height}");
            let expected = normal_loss(seen, &depth, &normal, WEIGHT);
            let error = (ours.loss - expected).abs() / expected;
            let v = normal_loss_backward(seen, &depth, &normal, 3.0 * WEIGHT);
            let by_depth = relative_error(&ours.v_depth, &v.depth);
            let by_normal = relative_error(&ours.v_normal, v.normal.as_flattened());
            let [own, other] = ours.cameras[..] else { panic!("{} cameras", ours.cameras.len()) };
            let by_lens = relative_error(&own.to_array(), &v.camera.to_array());
            println!("{what}: loss {error:.1e}, by depth {by_depth:.1e}, normal {by_normal:.1e}, lens {by_lens:.1e}");
            assert!(error <= 1e-5, "{what}: loss {} against {expected}", ours.loss);
            assert!(by_depth <= 1e-4 && by_normal <= 1e-5 && by_lens <= 1e-4, "{what}");
            assert_eq!(other, CameraChange::default(), "{what}: a source");
            for (a, b) in ours.v_depth.iter().zip(&v.depth) {
                assert!(*b != 0.0 || *a == 0.0, "{what}: {a} where the truth is zero");
            }
            assert_eq!(v.depth.iter().any(|v| *v != 0.0), width >= 3 && height >= 3, "{what}: gradient by depth");
            assert!(v.normal.as_flattened().iter().any(|v| *v != 0.0), "{what}: gradient by normal");
        }
    }

    #[test]
    fn gradients_are_added_to_what_is_there() {
        let camera = random_camera(33, 17, 5);
        let (depth, normal) = surface(&camera, 5, true);
        let seen = Surface { camera: &camera, valid: &vec![true; depth.len()] };
        let fresh = on_gpu(seen, &depth, &normal, 0.0);
        let added = on_gpu(seen, &depth, &normal, BEFORE);
        let same = |sum: &[f64], part: &[f64]| {
            let expected = |v: &f64| f64::from(BEFORE + *v as f32);
            sum.iter().zip(part).all(|(a, b)| *a == expected(b))
        };
        assert!(same(&added.v_depth, &fresh.v_depth) && same(&added.v_normal, &fresh.v_normal));
    }

    #[test]
    fn the_normals_of_a_frontal_plane_cost_only_the_border() {
        let camera = random_camera(24, 16, 7);
        let depth = vec![2.5; 24 * 16];
        let normal = vec![[0.0, 0.0, -1.0]; 24 * 16];
        let ours = on_gpu(Surface { camera: &camera, valid: &[true; 24 * 16] }, &depth, &normal, 0.0);
        let border = (24.0 * 16.0 - 22.0 * 14.0) / (24.0 * 16.0);
        assert!((ours.loss - WEIGHT * border).abs() < 1e-8, "{} for a border of {border}", ours.loss);
        assert!(ours.v_depth.iter().all(|v| v.abs() < 1e-9), "nothing to gain by another depth");
    }

    #[test]
    fn what_the_photo_masks_has_no_part() {
        let camera = random_camera(33, 17, 6);
        let (depth, normal) = surface(&camera, 6, false);
        // The right half is masked: beside the border of the mask its depth still makes the normals of the left half.
        let valid: Vec<bool> = (0..depth.len()).map(|i| i % 33 < 16).collect();
        let masked = on_gpu(Surface { camera: &camera, valid: &valid }, &depth, &normal, BEFORE);
        let open = on_gpu(Surface { camera: &camera, valid: &vec![true; depth.len()] }, &depth, &normal, BEFORE);
        assert!(masked.loss > 0.0 && masked.loss < 0.7 * open.loss, "{} of {}", masked.loss, open.loss);
        for (i, v) in masked.v_depth.iter().enumerate().filter(|(i, _)| i % 33 > 16) {
            assert!(
                *v == f64::from(BEFORE) && masked.v_normal[3 * i..3 * i + 3] == [f64::from(BEFORE); 3],
                "pixel {i}"
            );
        }
        assert!(open.v_depth.iter().enumerate().any(|(i, v)| i % 33 > 16 && *v != f64::from(BEFORE)));
    }

    fn depth_normals_on_gpu(camera: &Camera, depth: &[f64]) -> Vec<f64> {
        let gpu = gpu();
        let narrow: Vec<f32> = depth.iter().map(|z| *z as f32).collect();
        let depth_map = gpu.upload("depth", &narrow).unwrap();
        let surface = SurfaceBuffers { depth: depth_map, ..SurfaceBuffers::new(&gpu, camera).unwrap() };
        let out = gpu.allocate("depth normals", 3 * depth.len()).unwrap();
        let mut pass = Pass::new(&gpu, "test");
        surface.record_depth_normals(&mut pass, &out);
        pass.submit();
        gpu.read(&out, 3 * depth.len()).unwrap().into_iter().map(f64::from).collect()
    }

    #[test]
    fn depth_normals_follow_the_twin_at_every_size() {
        for (seed, (width, height)) in (0..).zip([(1, 1), (2, 5), (3, 3), (13, 9), (16, 16), (33, 17), (70, 50)]) {
            let camera = random_camera(width, height, seed);
            let (depth, _) = surface(&camera, seed, seed % 2 == 1);
            let (ours, truth) = (depth_normals_on_gpu(&camera, &depth), depth_normals(&camera, &depth));
            let error = relative_error(&ours, truth.as_flattened());
            println!("{width} x {height}: {error:.1e}");
            assert!(error <= 1e-5, "{width} x {height}: {error:e}");
            let inner = width >= 3 && height >= 3;
            assert_eq!(truth.as_flattened().iter().any(|v| *v != 0.0), inner, "{width} x {height}: nothing to compare");
        }
    }

    #[test]
    fn a_frontal_plane_faces_the_camera_and_the_border_has_no_normal() {
        let camera = random_camera(24, 16, 7);
        let inner = |i: usize| (1..23).contains(&(i % 24)) && (1..15).contains(&(i / 24));
        for (i, normal) in depth_normals_on_gpu(&camera, &[2.5; 24 * 16]).chunks_exact(3).enumerate() {
            let expected = if inner(i) { [0.0, 0.0, -1.0] } else { [0.0; 3] };
            assert_eq!(normal, expected, "pixel {i}");
        }
    }
}
