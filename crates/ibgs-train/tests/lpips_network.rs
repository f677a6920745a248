//! A network of LPIPS with random weights, as files.

use ibgs_reference::lpips::{Layer, Network};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use safetensors::tensor::{Dtype, TensorView, serialize_to_file};
use std::path::Path;
use std::sync::OnceLock;

/// Outputs of each block's layers, and how often.
const SHAPE: [(usize, usize); 5] = [(64, 2), (128, 2), (256, 3), (512, 3), (512, 3)];
/// Their numbers in torchvision's network.
const NUMBERS: [&[usize]; 5] = [&[0, 2], &[5, 7], &[10, 12, 14], &[17, 19, 21], &[24, 26, 28]];

/// A network of random weights, about as large as those of a trained one.
pub fn network() -> &'static Network {
    static NETWORK: OnceLock<Network> = OnceLock::new();
    NETWORK.get_or_init(|| {
        let mut rng = ChaCha8Rng::seed_from_u64(11);
        let mut inputs = 3;
        let mut network = Network { blocks: Vec::new(), linear: Vec::new() };
        for (outputs, count) in SHAPE {
            let mut block = Vec::new();
            for _ in 0..count {
                let bound = (6.0 / (9 * inputs) as f32).sqrt();
                let weight = (0..9 * inputs * outputs).map(|_| rng.random_range(-bound..bound)).collect();
                block.push(Layer { weight, bias: (0..outputs).map(|_| rng.random_range(-0.1..0.1)).collect() });
                inputs = outputs;
            }
            network.blocks.push(block);
            network.linear.push((0..outputs).map(|_| rng.random_range(0.0..1.0)).collect());
        }
        network
    })
}

pub type Named = Vec<(String, Vec<usize>, Vec<f32>)>;

/// The network's tensors: trunk, then linear layers. `package`: under the names of the `lpips` package, else torchvision's.
pub fn tensors(package: bool) -> (Named, Named) {
    let (mut trunk, mut linear, mut inputs) = (Named::new(), Named::new(), 3);
    for (b, (block, weights)) in network().blocks.iter().zip(&network().linear).enumerate() {
        for (layer, number) in block.iter().zip(NUMBERS[b]) {
            let outputs = layer.bias.len();
            let name = if package { format!("net.slice{}.{number}", b + 1) } else { format!("features.{number}") };
            trunk.push((format!("{name}.weight"), vec![outputs, inputs, 3, 3], layer.weight.clone()));
            trunk.push((format!("{name}.bias"), vec![outputs], layer.bias.clone()));
            inputs = outputs;
        }
        linear.push((format!("lin{b}.model.1.weight"), vec![1, inputs, 1, 1], weights.clone()));
    }
    (trunk, linear)
}

/// Writes tensors as a file.
pub fn write(path: &Path, tensors: &Named) {
    let view = |(name, shape, values): &(String, Vec<usize>, Vec<f32>)| {
        (name.clone(), shape.clone(), bytemuck::cast_slice::<f32, u8>(values).to_vec())
    };
    let held: Vec<_> = tensors.iter().map(view).collect();
    let views =
        held.iter().map(|(name, shape, bytes)| (name, TensorView::new(Dtype::F32, shape.clone(), bytes).unwrap()));
    serialize_to_file(views, None, path).unwrap();
}

/// The network as one file under the package's names.
pub fn write_network(path: &Path) {
    let (mut all, linear) = tensors(true);
    all.extend(linear);
    write(path, &all);
}
