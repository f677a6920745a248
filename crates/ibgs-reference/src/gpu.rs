//! One GPU for all tests, and models and images carried between the twins and the device.

use crate::surface_scene::Scene;
use crate::warp::Source;
use crate::{Model, Params, Tensor};
use ibgs_data::camera::Camera;
use ibgs_data::dataset::Photo;
use ibgs_data::local_space::LocalSpace;
use ibgs_data::scene::Gaussians;
use ibgs_render::gpu::{AdapterChoice, Buffer, Gpu, Use, device_descriptor};
use ibgs_render::raster::{RasterView, Rasterizer, SurfaceOptions};
use ibgs_render::scene::Splats;
use ibgs_render::sources::{DevicePhoto, SourceView};
use ibgs_shaders::{RENDER_KERNELS, TRAIN_KERNELS};
use std::path::Path;
use std::sync::{Arc, OnceLock};

/// The GPU; a machine without any adapter fails the tests. `IBGS_TEST_ADAPTER` chooses one by name.
pub fn gpu() -> Arc<Gpu> {
    static GPU: OnceLock<Arc<Gpu>> = OnceLock::new();
    GPU.get_or_init(open_gpu).clone()
}

/// The same adapter once more, as a device that no other test uses. `IBGS_TEST_WITHOUT` lists what it is to do without;
/// `IBGS_TEST_TRANSLATION` names the folder of `.ci/portable`, whose kernels in SPIR-V take the place of our own.
pub fn open_gpu() -> Arc<Gpu> {
    let choice = std::env::var("IBGS_TEST_ADAPTER").map_or(AdapterChoice::Best, AdapterChoice::Named);
    let usual = Gpu::open(&choice, Use::Training).expect("the tests need a GPU adapter; a software one will do");
    let without = std::env::var("IBGS_TEST_WITHOUT").unwrap_or_default();
    let mut without = without
        .split(',')
        .filter(|word| !word.is_empty())
        .fold(wgpu::Features::empty(), |all, word| all | feature(word));
    let gpu = match std::env::var_os("IBGS_TEST_TRANSLATION") {
        None if without.is_empty() => usual,
        None => device_without(&usual, without),
        Some(folder) => {
            let lanes = usual.subgroup_lanes.filter(|_| !without.contains(wgpu::Features::SUBGROUP));
            without |= wgpu::Features::IMMEDIATES | wgpu::Features::EXPERIMENTAL_COOPERATIVE_MATRIX;
            let mut gpu = device_without(&usual, without);
            translate(&gpu, Path::new(&folder), lanes);
            // The host launches some forms in grids of their own.
            Arc::get_mut(&mut gpu).expect("nothing else has it yet").subgroup_lanes = lanes;
            gpu
        }
    };
    println!("adapter: {}", gpu.describe());
    gpu
}

/// What a word of `IBGS_TEST_WITHOUT` takes away.
fn feature(word: &str) -> wgpu::Features {
    match word {
        "subgroups" => SUBGROUPS,
        "f16" => wgpu::Features::SHADER_F16 | wgpu::Features::EXPERIMENTAL_COOPERATIVE_MATRIX,
        "immediates" => wgpu::Features::IMMEDIATES | wgpu::Features::EXPERIMENTAL_COOPERATIVE_MATRIX,
        "all" => ALL,
        _ => panic!("IBGS_TEST_WITHOUT: `{word}` is none of subgroups, f16, immediates, all"),
    }
}

/// All but what burn's own kernels use where the adapter has it, though the device was not asked for it.
const ALL: wgpu::Features =
    wgpu::Features::all().difference(wgpu::Features::SHADER_INT64.union(wgpu::Features::SHADER_FLOAT32_ATOMIC));

/// Subgroups and what needs them.
const SUBGROUPS: wgpu::Features = wgpu::Features::SUBGROUP
    .union(wgpu::Features::SUBGROUP_BARRIER)
    .union(wgpu::Features::EXPERIMENTAL_COOPERATIVE_MATRIX);

/// Another device of the adapter, without these features; without all: with no higher limits than a training needs, and those of
/// a browser's default else.
fn device_without(usual: &Gpu, features: wgpu::Features) -> Arc<Gpu> {
    let gpu = another(usual, |adapter| {
        let mut descriptor = device_descriptor(adapter);
        descriptor.required_features.remove(features);
        if features.contains(ALL) {
            descriptor.required_limits = wgpu::Limits {
                max_storage_buffers_per_shader_stage: 18,
                max_compute_workgroup_storage_size: 31 << 10,
                ..wgpu::Limits::default()
            };
        } else if features.contains(wgpu::Features::IMMEDIATES) {
            descriptor.required_limits.max_immediate_size = 0;
        }
        descriptor
    });
    gpu.watch();
    gpu
}

/// Replaces the kernels by those of a folder: of the form for subgroups of this many lanes where there is one, else plain. All
/// have to be there, but for those for matrix units.
fn translate(gpu: &Gpu, folder: &Path, lanes: Option<u32>) {
    let mut of_subgroups = 0;
    for &kernel in RENDER_KERNELS.iter().chain(TRAIN_KERNELS) {
        let path = |form: &str| folder.join(form).join(format!("{}.spv", kernel.name));
        let for_lanes = lanes.map(|lanes| path(&format!("subgroups{lanes}"))).filter(|path| path.exists());
        of_subgroups += u32::from(for_lanes.is_some());
        let file = for_lanes.unwrap_or_else(|| path("plain"));
        let bytes = std::fs::read(&file).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
        gpu.replace_kernel(kernel, &spirv_module(gpu, kernel.name, &bytes));
        gpu.check().unwrap_or_else(|e| panic!("{}: {e}", file.display()));
    }
    println!("translated kernels of {}, {of_subgroups} of them for subgroups", folder.display());
}

#[expect(unsafe_code, reason = "wgpu asks for it")]
fn spirv_module(gpu: &Gpu, name: &str, bytes: &[u8]) -> wgpu::ShaderModule {
    let words = bytes.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word)).collect();
    let descriptor = wgpu::ShaderModuleDescriptorPassthrough {
        label: Some(name),
        entry_points: [wgpu::PassthroughShaderEntryPoint { name: "main".into(), workgroup_size: (0, 0, 0) }]
            .to_vec()
            .into(),
        spirv: Some(words),
        ..Default::default()
    };
    // SAFETY: a translation of one of our kernels, with naga's checks of bounds, that the validator of SPIR-V accepts.
    unsafe { gpu.device.create_shader_module_passthrough(descriptor) }
}

/// The tests' adapter as another device, as described.
pub fn device_of(describe: impl FnOnce(&wgpu::Adapter) -> wgpu::DeviceDescriptor<'static>) -> Arc<Gpu> {
    another(&gpu(), describe)
}

fn another(usual: &Gpu, describe: impl FnOnce(&wgpu::Adapter) -> wgpu::DeviceDescriptor<'static>) -> Arc<Gpu> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
    let same = |adapter: &wgpu::Adapter| adapter.get_info().name == usual.info.name;
    let adapter = adapters.into_iter().find(same).expect("the tests' adapter");
    let (device, queue) = pollster::block_on(adapter.request_device(&describe(&adapter))).unwrap();
    Gpu::from_wgpu(instance, adapter, device, queue).unwrap()
}

/// A device whose kernels do without subgroups, as in browsers.
pub fn without_subgroups() -> Arc<Gpu> {
    device_without(&gpu(), SUBGROUPS)
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
        opacity_logits: p.get_f32(Tensor::OpacityLogits),
        sh: p.get_f32(Tensor::Sh),
        sh_degree: p.sh_degree as u32,
        normals: vec![[0.0, 0.0, 1.0]; n],
        offsets: vec![0.0; n],
        antialiased: false,
    }
}

/// The same of a scene, with its planes.
pub fn scene_gaussians(scene: &Scene) -> Gaussians {
    Gaussians {
        normals: scene.planes.normals.iter().map(|n| n.map(|x| x as f32)).collect(),
        offsets: scene.planes.offsets.iter().map(|x| *x as f32).collect(),
        ..gaussians(&scene.params)
    }
}

/// The twin's parameters on the device.
pub fn splats(p: &Params) -> Splats {
    Splats::upload(&gaussians(p), &gpu()).unwrap()
}

/// A scene's model with its planes on the device.
pub fn scene_splats(scene: &Scene) -> Splats {
    Splats::upload(&scene_gaussians(scene), &gpu()).unwrap()
}

/// In single precision.
pub fn floats(values: impl IntoIterator<Item = f64>) -> Vec<f32> {
    values.into_iter().map(|v| v as f32).collect()
}

/// A camera's image on the device.
pub fn pixels(image: &Buffer<f32>, camera: &Camera) -> Vec<f64> {
    gpu().read(image, 3 * camera.pixels()).unwrap().into_iter().map(f64::from).collect()
}

/// The image that the GPU makes, row by row.
pub fn render(p: &Params, view: &RasterView) -> Vec<f64> {
    pixels(&rasterizer().render(&splats(p), view).unwrap(), &view.camera)
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

/// A view before a coloured background.
pub fn view(camera: Camera, degree: u32) -> RasterView {
    RasterView { background: [0.1, 0.5, 0.9], ..RasterView::new(camera, degree) }
}

/// That background.
pub fn background() -> [f64; 3] {
    [0.1f32, 0.5, 0.9].map(f64::from)
}

/// The view of a scene on the device.
pub fn view_of(scene: &Scene, ray_offset: f64) -> RasterView {
    let ideal = scene.model == Model::Ideal;
    let usual = RasterView::new(scene.camera, scene.params.sh_degree as u32);
    RasterView {
        background: scene.background.map(|v| v as f32),
        box_sigma: if scene.model == Model::Boxed { 3.0 } else { 0.0 },
        tangent_limit: if ideal { 1e6 } else { usual.tangent_limit },
        surface: Some(SurfaceOptions { intersections: scene.k as u32, ray_offset }),
        ..usual
    }
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
