//! A part of a tensor.

use super::unary;
use crate::tensor::{bind, empty, empty_like};
use burn::tensor::Tensor;
use burn_cubecl::tensor::CubeTensor;
use ibgs_core::gpu::{Gpu, GpuError, Pass};
use std::ops::Range;
use std::sync::Arc;

/// The elements `range` of a dimension, on the autodiff graph.
///
/// # Errors
/// Not enough memory.
///
/// # Panics
/// When the tensor is not on the autodiff graph, or shorter: bugs of ours.
pub fn slice(gpu: &Arc<Gpu>, tensor: Tensor<3>, axis: usize, range: Range<usize>) -> Result<Tensor<3>, GpuError> {
    unary(tensor, |whole| {
        let shape = whole.meta.shape().to_vec();
        let mut kept = shape.clone();
        kept[axis] = range.len();
        let values = |shape: &[usize]| shape[axis..].iter().product::<usize>();
        let (blocks, block, part) = (shape[..axis].iter().product::<usize>(), values(&shape), values(&kept));
        let before = block / shape[axis] * range.start;
        let out = empty(gpu, "part of a tensor", &kept)?;
        let mut pass = Pass::new(gpu, "part of a tensor");
        for b in 0..blocks {
            pass.copy(&bind(&whole).part(b * block + before, part), &bind(&out), b * part, part);
        }
        pass.submit();
        let gpu = gpu.clone();
        let rule = move |v_out: &CubeTensor| {
            let v = empty_like(v_out, &shape);
            let mut pass = Pass::new(&gpu, "part of a tensor, backward");
            pass.clear(&bind(&v));
            for b in 0..blocks {
                pass.copy(&bind(v_out).part(b * part, part), &bind(&v), b * block + before, part);
            }
            pass.submit();
            Some(v)
        };
        Ok::<_, GpuError>((out, rule))
    })
}
