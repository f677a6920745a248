//! One GPU for all tests, and models carried between the twins and the device.

use crate::reference::{Params, Tensor as Name};
use burn::tensor::{Tensor, TensorData};
use ibgs_core::gpu::{AdapterChoice, Gpu};
use ibgs_core::raster::{Leaves, RasterView, Rasterizer};
use ibgs_core::scene::{Gaussians, Splats};
use std::sync::{Arc, OnceLock};

/// The GPU; a machine without any adapter fails the tests. `IBGS_TEST_ADAPTER` chooses one by name.
pub fn gpu() -> Arc<Gpu> {
    static GPU: OnceLock<Arc<Gpu>> = OnceLock::new();
    let open = || {
        let choice = std::env::var("IBGS_TEST_ADAPTER").map_or(AdapterChoice::Best, AdapterChoice::Named);
        let gpu = Gpu::open(&choice).expect("the tests need a GPU adapter; a software one will do");
        println!("adapter: {}", gpu.describe());
        gpu
    };
    GPU.get_or_init(open).clone()
}

/// A fresh rasterizer on it.
pub fn rasterizer() -> Rasterizer {
    Rasterizer::new(gpu())
}

/// The twin's parameters as a model on the host.
pub fn gaussians(p: &Params) -> Gaussians {
    let n = p.len();
    Gaussians {
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
    Splats::upload(&gaussians(p), &gpu()).unwrap()
}

/// Values of a tensor.
pub fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f64> {
    tensor.into_data().try_into_vec::<f32>().unwrap().into_iter().map(f64::from).collect()
}

/// The image that the GPU makes, row by row.
pub fn render(p: &Params, view: &RasterView) -> Vec<f64> {
    values(rasterizer().render(&splats(p), view).unwrap())
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
    let model = splats(p);
    // Makes room for every intersection.
    raster.render(&model, view).unwrap();
    let leaves = Leaves::new(&model);
    let (image, _pass) = raster.tracked(&leaves, view).unwrap();
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
