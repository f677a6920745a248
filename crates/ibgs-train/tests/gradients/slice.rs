//! A part of a tensor on burn's graph.

use crate::common::values;
use ibgs_reference::gpu::gpu;
use ibgs_train::autodiff::slice;
use ibgs_train::tensor::{from_primitive, upload};

#[test]
fn a_part_is_that_of_burn_and_gives_its_gradient_back() {
    let gpu = gpu();
    for (axis, range, shape) in [(0, 2..5, [7, 4, 3]), (1, 3..9, [3, 10, 4]), (1, 0..10, [2, 10, 4])] {
        let count: usize = shape.iter().product();
        let numbers = |scale: f32| (0..count).map(|i| scale * (i as f32 - 40.0)).collect::<Vec<_>>();
        let tensor = |scale| from_primitive::<3>(upload(&gpu, "whole", &numbers(scale), &shape).unwrap()).autodiff();
        let (whole, weights) = (tensor(1.0).require_grad(), tensor(0.25).narrow(axis, range.start, range.len()));
        let same = tensor(1.0).require_grad();
        let burns = same.clone().narrow(axis, range.start, range.len());
        let ours = slice(&gpu, whole.clone(), axis, range).unwrap();
        assert_eq!(values(ours.clone().inner()), values(burns.clone().inner()), "{shape:?}");
        let [ours, burns] = [(ours, whole), (burns, same)].map(|(part, leaf)| {
            let gradients = (part * weights.clone()).sum().backward();
            values(leaf.grad(&gradients).expect("the sum depends on it"))
        });
        assert!(burns.iter().any(|v| *v != 0.0), "{shape:?}: nothing to compare");
        assert_eq!(ours, burns, "{shape:?}");
    }
}
