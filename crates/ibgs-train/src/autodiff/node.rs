//! The crate's one way onto burn's graph.

use crate::tensor::contiguous;
use burn::backend::Autodiff;
use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::NoCheckpointing;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::tensor::Tensor;
use burn_cubecl::tensor::CubeTensor;
use burn_wgpu::CubeBackend;
use ibgs_core::gpu::flush;
use std::cell::RefCell;
use std::collections::HashSet;
use std::fmt;
use std::sync::Arc;

type Ad = Autodiff<CubeBackend>;

/// A tensor on the graph, of any number of dimensions.
pub type OnGraph = <Ad as burn::backend::BackendTypes>::FloatTensorPrimitive;

/// A tensor as a node's parent.
///
/// # Panics
/// When it is not on the autodiff graph: a bug of ours.
pub fn on_graph<const D: usize>(tensor: Tensor<D>) -> OnGraph {
    tensor.try_into_primitive::<Ad>().expect("the tensor is on the autodiff graph")
}

/// Makes the gradients by the parents from that by the node; its argument says which parents learn.
type Gradient<const N: usize> = dyn Fn(&CubeTensor, [bool; N]) -> [Option<CubeTensor>; N] + Send + Sync;

#[derive(Clone)]
struct Rule<const N: usize>(Arc<Gradient<N>>);

impl<const N: usize> fmt::Debug for Rule<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Rule")
    }
}

thread_local! {
    /// Nodes whose gradients this thread has registered and not yet consumed, leaves aside.
    static HAVE_GRADIENTS: RefCell<HashSet<u64>> = RefCell::default();
}

#[derive(Debug)]
struct Node;

impl<const N: usize> Backward<CubeBackend, N> for Node {
    type State = Rule<N>;

    fn backward(self, ops: Ops<Rule<N>, N>, grads: &mut Gradients, _: &mut Checkpointer) {
        HAVE_GRADIENTS.with_borrow_mut(|nodes| nodes.remove(&ops.node.id.value));
        let v = contiguous(grads.consume::<CubeBackend>(&ops.node));
        let gradients = (ops.state.0)(&v, ops.parents.each_ref().map(Option::is_some));
        for (parent, gradient) in ops.parents.into_iter().zip(gradients) {
            if let Some((parent, gradient)) = parent.zip(gradient) {
                // burn adds it to another that the batch may still hold.
                if parent.order > 0 && !HAVE_GRADIENTS.with_borrow_mut(|nodes| nodes.insert(parent.id.value)) {
                    flush();
                }
                grads.register::<CubeBackend>(parent.id, gradient);
            }
        }
    }
}

/// A tensor on the autodiff graph of its parents. `compute` makes it of their contiguous values, and returns the rule that makes
/// their gradients from its own: none for a parent whose gradient does not flow through the graph.
///
/// # Errors
/// Those of `compute`.
pub fn node<const N: usize, const E: usize, Rules, Error>(
    parents: [OnGraph; N],
    compute: impl FnOnce([CubeTensor; N]) -> Result<(CubeTensor, Rules), Error>,
) -> Result<Tensor<E>, Error>
where
    Rules: Fn(&CubeTensor, [bool; N]) -> [Option<CubeTensor>; N] + Send + Sync + 'static,
{
    let nodes = parents.each_ref().map(|parent| parent.node());
    let (output, rule) = compute(parents.map(|parent| contiguous(parent.into_primitive())))?;
    let output = match Node.prepare::<NoCheckpointing>(nodes).compute_bound().stateful() {
        OpsKind::Tracked(prep) => prep.finish(Rule(Arc::new(rule)), output),
        OpsKind::UnTracked(prep) => prep.finish(output),
    };
    Ok(Tensor::from_primitive::<Ad>(output))
}

/// A node with one parent.
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
    node([on_graph(parent)], |[parent]| {
        let (output, rule) = compute(parent)?;
        Ok((output, move |v: &CubeTensor, _| [rule(v)]))
    })
}
