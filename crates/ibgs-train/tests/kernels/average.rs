//! The mean of the images of an ensemble, and its gradient, against the twin.

use crate::common::values;
use burn::tensor::{Tensor, TensorData};
use ibgs_reference::gpu::gpu;
use ibgs_reference::random_scene::random_image;
use ibgs_reference::relative_error;
use ibgs_train::autodiff;
use ibgs_train::tensor::device;

#[test]
fn a_mean_and_its_gradient_follow_the_twin() {
    let gpu = gpu();
    for [width, height] in [[1, 1], [33, 21], [16, 16]] {
        let image = |seed: u64| random_image(width, height, -0.5, 1.5, seed).into_flattened();
        let single = |image: &[f64]| image.iter().map(|v| *v as f32).collect::<Vec<f32>>();
        let tensor = |image: &[f64]| {
            let data = TensorData::new(single(image), [height as usize, width as usize, 3]);
            Tensor::<3>::from_data(data, device(&gpu).unwrap())
        };
        let (own, cotangent) = (image(1), image(9));
        let members = [image(2), image(3), image(4)];
        for used in 0..=members.len() {
            let uploaded: Vec<_> =
                members[..used].iter().map(|member| gpu.upload("member", &single(member)).unwrap()).collect();
            let leaf = tensor(&own).autodiff().require_grad();
            let mean = autodiff::averaged(&gpu, leaf.clone(), &uploaded).unwrap();
            let part = 1.0 / (used as f64 + 1.0);
            let twin = |i: usize| part * (own[i] + members[..used].iter().map(|member| member[i]).sum::<f64>());
            let twin: Vec<f64> = (0..own.len()).map(twin).collect();
            let error = relative_error(&values(mean.clone().inner()), &twin);
            let mut gradients = (mean * tensor(&cotangent).autodiff()).sum().backward();
            let found = values(leaf.grad_remove(&mut gradients).unwrap());
            let expected: Vec<f64> = cotangent.iter().map(|v| part * v).collect();
            let by_image = relative_error(&found, &expected);
            assert!(error < 1e-6 && by_image < 1e-6, "{used} members: {error:.1e}, {by_image:.1e}");
            assert!(found.iter().any(|v| v.abs() > 0.01));
        }
    }
}
