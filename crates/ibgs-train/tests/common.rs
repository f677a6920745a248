//! Models as a training has them, and their gradients under burn's autodiff, in the shapes of the twins.

use burn::tensor::{Tensor, TensorData};
use glam::DVec3;
use ibgs_core::camera_change::CameraChange;
use ibgs_core::raster::{CameraGradients, Forward, RasterView};
use ibgs_core::scene::PerGaussian;
use ibgs_core::sources::{WarpOptions, Warper};
use ibgs_reference::geometry_backward::Cotangents;
use ibgs_reference::gpu::{floats, gaussians, gpu, rasterizer, scene_gaussians, source_view};
use ibgs_reference::surface_scene::{Scene, TENSORS};
use ibgs_reference::{Params, Tensor as Name, sh};
use ibgs_train::autodiff::{self, Leaves, SplatGradients};
use ibgs_train::parameters::Parameters;
use ibgs_train::tensor::device;

/// The twin's parameters as a training has them.
pub fn parameters(p: &Params) -> Parameters {
    Parameters::upload(&gaussians(p), &gpu()).unwrap()
}

/// Values of a tensor.
pub fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f64> {
    tensor.into_data().try_into_vec::<f32>().unwrap().into_iter().map(f64::from).collect()
}

/// The gradients in the shapes of the twin: by the coefficients of the spherical harmonics in place of the colours.
pub fn by_parameters(g: SplatGradients, p: &Params, view: &RasterView) -> PerGaussian<Option<Vec<f64>>> {
    let gradients = g.map(|gradient| gradient.map(values));
    let active = (view.sh_degree as usize + 1).pow(2);
    let by_coefficients = |(v, mean): (&[f64], &[f64; 3])| {
        let basis = sh::basis((DVec3::from(*mean) - view.camera.center()).normalize());
        // Without a gradient the mean may be no number.
        let counts = |k: usize| k < active && v.iter().any(|v| *v != 0.0);
        let each = (0..p.sh_coefficients()).map(|k| if counts(k) { basis[k] } else { 0.0 });
        each.flat_map(|basis| [0, 1, 2].map(|c| basis * v[c])).collect::<Vec<_>>()
    };
    let sh = gradients.sh.as_ref().map(|v| v.chunks_exact(3).zip(&p.means).flat_map(by_coefficients).collect());
    PerGaussian { sh, ..gradients }
}

/// Gradients of `sum(cotangent * image)` on the GPU, in the twin's order, and the screen-space ones, [N, 4].
pub struct GpuGradients {
    tensors: PerGaussian<Option<Vec<f64>>>,
    /// (x, y, |x|, |y|) of each Gaussian.
    pub screen: Vec<f64>,
}

impl GpuGradients {
    /// One tensor's gradient.
    pub fn get(&self, name: Name) -> &[f64] {
        self.tensors.as_ref().into_array()[name as usize].as_ref().unwrap()
    }

    /// Columns `from..from + 2` of the screen-space gradient.
    pub fn screen_pair(&self, from: usize) -> Vec<f64> {
        self.screen.chunks_exact(4).flat_map(|row| [row[from], row[from + 1]]).collect()
    }
}

/// Runs forward and backward under burn's autodiff.
pub fn gradients(p: &Params, view: &RasterView, cotangent: &[[f64; 3]]) -> GpuGradients {
    gradients_with(p, view, cotangent, None)
}

/// Gradient of `sum(cotangent * image)` by the camera.
pub fn camera_gradient_of_image(p: &Params, view: &RasterView, cotangent: &[[f64; 3]]) -> CameraChange {
    let cameras = CameraGradients::new(&gpu(), 0).unwrap();
    gradients_with(p, view, cotangent, Some(&cameras));
    cameras.read(&gpu()).unwrap()[0]
}

/// The rows of the intersections by screen position, summed by Gaussian: (x, y, |x|, |y|) in pixels, `[N, 4]`.
fn screen_sums(forward: &Forward) -> Vec<f64> {
    let (gpu, workspace, n) = (gpu(), &forward.workspace, forward.frame.count as usize);
    let read = |buffer| gpu.read(buffer, n).unwrap();
    let rows = gpu.read(&workspace.rows[1], workspace.rows[1].rows()).unwrap();
    let sum = |(offset, count): (u32, u32)| {
        let own = &rows[offset as usize..][..count as usize];
        [0, 1, 2, 3].map(|c| own.iter().map(|row| f64::from(row[c])).sum::<f64>())
    };
    read(&workspace.offsets).into_iter().zip(read(&workspace.tile_counts)).flat_map(sum).collect()
}

fn gradients_with(
    p: &Params,
    view: &RasterView,
    cotangent: &[[f64; 3]],
    cameras: Option<&CameraGradients>,
) -> GpuGradients {
    let raster = rasterizer();
    let model = parameters(p);
    // Makes room for every intersection.
    raster.render(model.splats(), view).unwrap();
    let leaves = Leaves::new(&model);
    let (image, forward) = autodiff::rasterized(&raster, &leaves, view, cameras, None).unwrap();
    let shape = image.dims();
    let cotangent: Vec<f32> = cotangent.as_flattened().iter().map(|v| *v as f32).collect();
    let cotangent = Tensor::<3>::from_data(TensorData::new(cotangent, shape), &image.device());
    let mut grads = (image * cotangent).sum().backward();
    let g = leaves.gradients(&mut grads).expect("the image reaches the loss");
    GpuGradients { tensors: by_parameters(g, p, view), screen: screen_sums(&forward) }
}

/// A scene's model as a training has it.
pub fn scene_parameters(scene: &Scene) -> Parameters {
    Parameters::upload(&scene_gaussians(scene), &gpu()).unwrap()
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
    /// Gradients by the cameras of target and sources.
    pub cameras: Vec<CameraChange>,
}

impl GpuSurface {
    /// The gradient of one tensor.
    pub fn grad(&self, name: &str) -> &[f64] {
        &self.grads.iter().find(|(n, _)| *n == name).unwrap_or_else(|| panic!("no tensor {name}")).1
    }
}

/// Renders and warps a scene under burn's autodiff and runs the backward pass for the cotangents `v`.
pub fn surface(scene: &Scene, view: &RasterView, warping: WarpOptions, v: &Cotangents) -> GpuSurface {
    let gpu = gpu();
    let raster = rasterizer();
    let model = scene_parameters(scene);
    raster.render(model.splats(), view).unwrap();
    let sources: Vec<_> = scene.sources.iter().map(source_view).collect();
    let warper = Warper::new(gpu.clone(), warping);
    let leaves = Leaves::new(&model);
    let cameras = CameraGradients::new(&gpu, sources.len()).unwrap();
    let (image, forward) = autodiff::rasterized(&raster, &leaves, view, Some(&cameras), None).unwrap();
    let (warped, pass) = autodiff::warped(&warper, &image, &forward, &sources).unwrap();
    let seen = pass.seen;
    let surface = forward.surface().unwrap();
    let pixels = v.depth.len();
    let visible = warping.visible as usize;
    let read = |buffer, count| -> Vec<f64> { gpu.read(buffer, count).unwrap().into_iter().map(f64::from).collect() };
    let warped_values = values(warped.clone().inner());
    let packed = gpu.read(&seen.visible, pixels).unwrap();
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
    let most_visible = gpu.read(&seen.most_visible, 1).unwrap()[0];
    let side = surface.v.as_ref().unwrap();
    let write = |buffer, values: Vec<f32>| gpu.write(buffer, 0, &values);
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
    let screen = screen_sums(&forward);
    let pair = |from: usize| screen.chunks_exact(4).flat_map(|row| [row[from], row[from + 1]]).collect::<Vec<_>>();
    let parameters =
        by_parameters(g, &scene.params, view).map(|gradient| gradient.expect("a surface has plane gradients"));
    let pairs = [("xy_pixels", pair(0)), ("xy_pixels_abs", pair(2))];
    let grads = TENSORS.into_iter().zip(parameters.into_array()).chain(pairs).collect();
    GpuSurface { outputs, source, error, most_visible, grads, cameras: cameras.read(&gpu).unwrap() }
}
