//! Nodes with one parent.

use crate::tensor::contiguous;
use burn::backend::Autodiff;
use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::NoCheckpointing;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::tensor::Tensor;
use burn_cubecl::tensor::CubeTensor;
use burn_wgpu::CubeBackend;
use std::fmt;
use std::sync::Arc;

/// Makes the gradient by the parent from that by the node; none where it goes elsewhere.
type Gradient = dyn Fn(&CubeTensor) -> Option<CubeTensor> + Send + Sync;

#[derive(Clone)]
struct Rule(Arc<Gradient>);

impl fmt::Debug for Rule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Rule")
    }
}

#[derive(Debug)]
struct Unary;

impl Backward<CubeBackend, 1> for Unary {
    type State = Rule;

    fn backward(self, ops: Ops<Rule, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        let v = contiguous(grads.consume::<CubeBackend>(&ops.node));
        let [parent] = ops.parents;
        if let Some((parent, gradient)) = parent.zip((ops.state.0)(&v)) {
            grads.register::<CubeBackend>(parent.id, gradient);
        }
    }
}

/// A tensor on the autodiff graph of its only parent. `compute` makes it of the parent's contiguous values, and returns the rule
/// that makes the parent's gradient from its own: none where that goes elsewhere, beside the graph.
///
/// # Errors
/// Those of `compute`.
///
/// # Panics
/// When the parent is not on the autodiff graph: a bug of ours.
pub fn unary<const D: usize, const E: usize, Rules, Error>(
    parent: Tensor<D>,
    compute: impl FnOnce(CubeTensor) -> Result<(CubeTensor, Rules), Error>,
) -> Result<Tensor<E>, Error>
where
    Rules: Fn(&CubeTensor) -> Option<CubeTensor> + Send + Sync + 'static,
{
    type Ad = Autodiff<CubeBackend>;
    let parent = parent.try_into_primitive::<Ad>().expect("the tensor is on the autodiff graph");
    let node = parent.node();
    let (output, rule) = compute(contiguous(parent.into_primitive()))?;
    let output = match Unary.prepare::<NoCheckpointing>([node]).compute_bound().stateful() {
        OpsKind::Tracked(prep) => prep.finish(Rule(Arc::new(rule)), output),
        OpsKind::UnTracked(prep) => prep.finish(output),
    };
    Ok(Tensor::from_primitive::<Ad>(output))
}
