//! One GPU for all tests, models carried between the twins and the device, and files beside the tests.

use crate::reference::geometry_backward::Cotangents;
use crate::reference::surface_scene::Scene;
use crate::reference::warp::Source;
use crate::reference::{Params, Tensor as Name};
use burn::tensor::{Tensor, TensorData};
use ibgs_core::camera::Camera;
use ibgs_core::dataset::Photo;
use ibgs_core::gpu::Buffer;
use ibgs_core::gpu::{AdapterChoice, Gpu, Use};
use ibgs_core::local_space::LocalSpace;
use ibgs_core::raster::{RasterView, Rasterizer};
use ibgs_core::scene::{Gaussians, Splats};
use ibgs_core::sources::DevicePhoto;
use ibgs_core::sources::{SourceView, WarpOptions, Warper};
use ibgs_train::autodiff::{self, Leaves};
use ibgs_train::parameters::Parameters;
use ibgs_train::tensor::device;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

/// The GPU; a machine without any adapter fails the tests. `IBGS_TEST_ADAPTER` chooses one by name.
pub fn gpu() -> Arc<Gpu> {
    static GPU: OnceLock<Arc<Gpu>> = OnceLock::new();
    GPU.get_or_init(open_gpu).clone()
}

/// The same adapter once more, as a device that no other test uses.
pub fn open_gpu() -> Arc<Gpu> {
    let choice = std::env::var("IBGS_TEST_ADAPTER").map_or(AdapterChoice::Best, AdapterChoice::Named);
    let gpu = Gpu::open(&choice, Use::Training).expect("the tests need a GPU adapter; a software one will do");
    println!("adapter: {}", gpu.describe());
    gpu
}

/// The tests' adapter as another device, as described.
pub fn device_of(describe: impl FnOnce(&wgpu::Adapter) -> wgpu::DeviceDescriptor<'static>) -> Arc<Gpu> {
    let usual = gpu();
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
    let same = |adapter: &wgpu::Adapter| adapter.get_info().name == usual.info.name;
    let adapter = adapters.into_iter().find(same).expect("the tests' adapter");
    let (device, queue) = pollster::block_on(adapter.request_device(&describe(&adapter))).unwrap();
    Gpu::from_wgpu(instance, adapter, device, queue).unwrap()
}

/// A file of `tests/fixtures`.
pub fn fixture(file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(file)
}

/// A file or folder of `../shared`, which is not in the repository; None where it is absent, and `test` is skipped.
pub fn shared(file: &str, test: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared").join(file);
    if path.exists() {
        return Some(path);
    }
    skipped(test, &format!("../shared/{file} is absent"));
    None
}

/// Says on stderr that `test` does not run, or only in part. The test passes all the same, and of a test that passes
/// libtest hides what the print macros write; it does not hide this.
pub fn skipped(test: &str, why: &str) {
    let line = format!("SKIPPED {test}: {why}\n");
    let _ = std::io::stderr().write_all(line.as_bytes());
}

/// A fresh rasterizer on it.
pub fn rasterizer() -> Rasterizer {
    Rasterizer::new(gpu())
}

/// The twin's parameters as a model on the host.
pub fn gaussians(p: &Params) -> Gaussians {
    let n = p.len();
    Gaussians {
        space: LocalSpace::default(),
        means: p.means.iter().map(|v| v.map(|x| x as f32)).collect(),
        rotations: p.rotations.iter().map(|v| v.map(|x| x as f32)).collect(),
        log_scales: p.log_scales.iter().map(|v| v.map(|x| x as f32)).collect(),
        opacity_logits: p.get_f32(Name::OpacityLogits),
        sh: p.get_f32(Name::Sh),
        sh_degree: p.sh_degree as u32,
        normals: vec![[0.0, 0.0, 1.0]; n],
        offsets: vec![0.0; n],
    }
}

/// The twin's parameters on the device.
pub fn splats(p: &Params) -> Splats {
    parameters(p).splats().clone()
}

/// The twin's parameters as a training has them.
pub fn parameters(p: &Params) -> Parameters {
    let parameters = Parameters::upload(&gaussians(p), &gpu()).unwrap();
    if !p.filters.is_empty() {
        parameters.splats().set_filters(&gpu(), &floats(p.filters.iter().copied()));
    }
    parameters
}

/// A camera's image on the device.
pub fn pixels(image: &Buffer, camera: &Camera) -> Vec<f64> {
    gpu().read::<f32>(image, 3 * camera.pixels()).unwrap().into_iter().map(f64::from).collect()
}

/// Values of a tensor.
pub fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f64> {
    tensor.into_data().try_into_vec::<f32>().unwrap().into_iter().map(f64::from).collect()
}

/// The image that the GPU makes, row by row.
pub fn render(p: &Params, view: &RasterView) -> Vec<f64> {
    pixels(&rasterizer().render(&splats(p), view).unwrap(), &view.camera)
}

/// Gradients of `sum(cotangent * image)` on the GPU, in the twin's order, and the screen-space ones, [N, 4].
pub struct GpuGradients {
    tensors: [Vec<f64>; 5],
    /// (x, y, |x|, |y|) of each Gaussian.
    pub screen: Vec<f64>,
}

impl GpuGradients {
    /// One tensor's gradient.
    pub fn get(&self, name: Name) -> &[f64] {
        let index = Name::ALL.iter().position(|n| *n == name).unwrap();
        &self.tensors[index]
    }

    /// Columns `from..from + 2` of the screen-space gradient.
    pub fn screen_pair(&self, from: usize) -> Vec<f64> {
        self.screen.chunks_exact(4).flat_map(|row| [row[from], row[from + 1]]).collect()
    }
}

/// Runs forward and backward under burn's autodiff.
pub fn gradients(p: &Params, view: &RasterView, cotangent: &[[f64; 3]]) -> GpuGradients {
    let raster = rasterizer();
    let model = parameters(p);
    // Makes room for every intersection.
    raster.render(model.splats(), view).unwrap();
    let leaves = Leaves::new(&gpu(), &model).unwrap();
    let (image, _pass) = autodiff::rasterized(&raster, &leaves, view).unwrap();
    let shape = image.dims();
    let cotangent: Vec<f32> = cotangent.as_flattened().iter().map(|v| *v as f32).collect();
    let cotangent = Tensor::<3>::from_data(TensorData::new(cotangent, shape), &image.device());
    let mut grads = (image * cotangent).sum().backward();
    let g = leaves.gradients(&mut grads).expect("the image reaches the loss");
    GpuGradients {
        tensors: [values(g.means), values(g.rotations), values(g.log_scales), values(g.opacity_logits), values(g.sh)],
        screen: values(g.screen),
    }
}

/// A scene's model with its planes on the device.
pub fn scene_splats(scene: &Scene) -> Splats {
    scene_parameters(scene).splats().clone()
}

/// The same as a training has it.
pub fn scene_parameters(scene: &Scene) -> Parameters {
    let mut g = gaussians(&scene.params);
    g.normals = scene.planes.normals.iter().map(|n| n.map(|x| x as f32)).collect();
    g.offsets = scene.planes.offsets.iter().map(|x| *x as f32).collect();
    Parameters::upload(&g, &gpu()).unwrap()
}

/// A twin's source on the device; its colours are 8-bit.
pub fn source_view(source: &Source) -> SourceView {
    let byte = |v: &f64| (v * 255.0).round() as u8;
    // Alpha under one half masks.
    let alpha = |valid: bool| if valid { 128 } else { 127 };
    let texel = |([r, g, b], valid): (&[f64; 3], &bool)| [byte(r), byte(g), byte(b), alpha(*valid)];
    let rgba = source.photo.iter().zip(&source.valid).flat_map(texel).collect();
    let photo = Photo { width: source.camera.width, height: source.camera.height, rgba };
    let depth: Vec<f32> = source.depth.iter().map(|d| *d as f32).collect();
    SourceView {
        camera: source.camera,
        photo: DevicePhoto::upload(&gpu(), &photo).unwrap(),
        depth: gpu().upload("source depth", &depth).unwrap(),
    }
}

/// What a target view gives on the GPU, in the shapes of the twin.
pub struct GpuSurface {
    /// Base, normal map, median depth, warped colours, cosines.
    pub outputs: Cotangents,
    /// Each visible source or -1, source by source.
    pub source: Vec<i32>,
    /// Step of the depth's error of each visible source, 0 where there is none.
    pub error: Vec<u8>,
    /// Most visible sources of any pixel.
    pub most_visible: u32,
    /// Gradients by tensor name.
    pub grads: Vec<(&'static str, Vec<f64>)>,
}

impl GpuSurface {
    /// The gradient of one tensor.
    pub fn grad(&self, name: &str) -> &[f64] {
        &self.grads.iter().find(|(n, _)| *n == name).unwrap_or_else(|| panic!("no tensor {name}")).1
    }
}

fn floats(values: impl IntoIterator<Item = f64>) -> Vec<f32> {
    values.into_iter().map(|v| v as f32).collect()
}

/// Renders and warps a scene under burn's autodiff and runs the backward pass for the cotangents `v`.
pub fn surface(scene: &Scene, view: &RasterView, warping: WarpOptions, v: &Cotangents) -> GpuSurface {
    let gpu = gpu();
    let raster = rasterizer();
    let model = scene_parameters(scene);
    raster.render(model.splats(), view).unwrap();
    let sources: Vec<_> = scene.sources.iter().map(source_view).collect();
    let warper = Warper::new(gpu.clone(), warping);
    let leaves = Leaves::new(&gpu, &model).unwrap();
    let (image, forward) = autodiff::rasterized(&raster, &leaves, view).unwrap();
    let (warped, pass) = autodiff::warped(&warper, &image, &forward, &sources).unwrap();
    let seen = pass.seen;
    let surface = forward.surface().unwrap();
    let pixels = v.depth.len();
    let visible = warping.visible as usize;
    let read =
        |buffer, count| -> Vec<f64> { gpu.read::<f32>(buffer, count).unwrap().into_iter().map(f64::from).collect() };
    let warped_values = values(warped.clone().inner());
    let packed: Vec<u32> = gpu.read(&seen.visible, pixels).unwrap();
    let bytes = (0..visible).flat_map(|m| packed.iter().map(move |word| word.to_le_bytes()[m]));
    let source = bytes.clone().map(|byte| if byte == 255 { -1 } else { i32::from(byte & 15) }).collect();
    let error = bytes.map(|byte| if byte == 255 { 0 } else { byte >> 4 }).collect();
    let outputs = Cotangents {
        base: values(image.clone().inner()).as_chunks().0.to_vec(),
        normal: read(&surface.normal_map, 3 * pixels).as_chunks().0.to_vec(),
        depth: read(&surface.median_depth, pixels),
        warped: warped_values.chunks_exact(4).map(|c| [c[0], c[1], c[2]]).collect(),
        cosine: warped_values.chunks_exact(4).map(|c| c[3]).collect(),
    };
    let most_visible = gpu.read::<u32>(&seen.most_visible, 1).unwrap()[0];
    let side = surface.v.as_ref().unwrap();
    let write = |buffer: &ibgs_core::gpu::Buffer, values: Vec<f32>| {
        gpu.queue.write_buffer(&buffer.buffer, 0, bytemuck::cast_slice(&values));
    };
    write(&side.normal_map, floats(v.normal.iter().flatten().copied()));
    write(&side.median_depth, floats(v.depth.iter().copied()));
    let v_warped = v.warped.iter().zip(&v.cosine).take(visible * pixels).flat_map(|(c, x)| [c[0], c[1], c[2], *x]);
    let tensor = |values: Vec<f32>, shape: [usize; 3]| {
        Tensor::<3>::from_data(TensorData::new(values, shape), device(&gpu).unwrap())
    };
    let v_image = tensor(floats(v.base.iter().flatten().copied()), image.dims()).autodiff();
    let v_warped = tensor(floats(v_warped), [visible, pixels, 4]).autodiff();
    let mut grads = ((image * v_image).sum() + (warped * v_warped).sum()).backward();
    let g = leaves.gradients(&mut grads).expect("the image reaches the loss");
    let (normals, offsets) = g.planes.expect("a surface has plane gradients");
    let screen = values(g.screen);
    let pair = |from: usize| screen.chunks_exact(4).flat_map(|row| [row[from], row[from + 1]]).collect::<Vec<_>>();
    let grads = vec![
        ("mean", values(g.means)),
        ("rotation", values(g.rotations)),
        ("log_scale", values(g.log_scales)),
        ("opacity_logit", values(g.opacity_logits)),
        ("sh", values(g.sh)),
        ("normal", values(normals)),
        ("offset", values(offsets)),
        ("xy_pixels", pair(0)),
        ("xy_pixels_abs", pair(2)),
    ];
    GpuSurface { outputs, source, error, most_visible, grads }
}

/// Asserts the forward bounds: all values within `tolerance`, but for at most 1e-4 of the pixels, which a threshold that
/// falls the other way in float32 may move by at most 1/128.
pub fn assert_images_agree(what: &str, ours: &[f64], twin: &[[f64; 3]], tolerance: f64) {
    assert_eq!(ours.len(), 3 * twin.len(), "{what}: size");
    let mut flipped = 0;
    let mut largest = 0.0f64;
    for (i, (a, b)) in ours.chunks_exact(3).zip(twin).enumerate() {
        let error = a.iter().zip(b).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
        assert!(error <= 1.0 / 128.0, "{what}: pixel {i} differs by {error}: {a:?} against {b:?}");
        if error > tolerance {
            flipped += 1;
        } else {
            largest = largest.max(error);
        }
    }
    println!("{what}: largest error {largest:.1e}, {flipped} of {} pixels flipped", twin.len());
    assert!(flipped as f64 <= 1e-4 * twin.len() as f64, "{what}: {flipped} of {} pixels flipped", twin.len());
}
