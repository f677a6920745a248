//! Adam.
#set train
#stage adam
// One thread a value: Adam with bias correction (method.md section 1), eps added to the corrected root. The values beyond the
// head decay by themselves, not through the gradient (Loshchilov and Hutter, Decoupled Weight Decay Regularization, 2019).
#import index

/// One Adam step of one tensor.
struct AdamParams {
    /// Number of values.
    count: u32,
    /// Values a row.
    row: u32,
    /// Leading values of a row that step with `rate`.
    head: u32,
    /// Learning rate of the head.
    rate: f32,
    /// Learning rate of the rest of the row.
    rate_rest: f32,
    /// Decay of the first moment.
    beta1: f32,
    /// Decay of the second moment.
    beta2: f32,
    /// Added to the root of the corrected second moment.
    eps: f32,
    /// 1 / (1 - beta1^t).
    correction1: f32,
    /// 1 / (1 - beta2^t).
    correction2: f32,
    /// Share of a value of the rest that is lost, times its rate.
    decay_rest: f32,
}

var<immediate> params: AdamParams;

@group(0) @binding(0) var<storage, read> gradient: array<f32>;
@group(0) @binding(1) var<storage, read_write> values: array<f32>;
@group(0) @binding(2) var<storage, read_write> moment1: array<f32>;
@group(0) @binding(3) var<storage, read_write> moment2: array<f32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_workgroup(wid, groups) * 256u + local;
    if i >= params.count {
        return;
    }
    let g = gradient[i];
    let m1 = params.beta1 * moment1[i] + (1.0 - params.beta1) * g;
    let m2 = params.beta2 * moment2[i] + (1.0 - params.beta2) * g * g;
    moment1[i] = m1;
    moment2[i] = m2;
    let is_head = i % params.row < params.head;
    let rate = select(params.rate_rest, params.rate, is_head);
    let kept = select(1.0 - rate * params.decay_rest, 1.0, is_head);
    values[i] = kept * values[i] - rate * (m1 * params.correction1) / (sqrt(m2 * params.correction2) + params.eps);
}
