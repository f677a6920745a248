//! Sum of the rows of weight gradients of [`RESIDUAL_FEATURES_BACKWARD`].
#set train
#stage features backward
// Sums the workgroups' gradients of the per-view MLP and of the confidence in a fixed order: 32 weights a workgroup, eight threads each.

/// Sum of the per-view MLP's gradients.
struct FeatureSumParams {
    /// Weights a row.
    count: u32,
    /// Rows.
    groups: u32,
    /// Weights of a row that lie at the front of the network's.
    first: u32,
    /// Where the others lie.
    rest: u32,
}

var<immediate> params: FeatureSumParams;

@group(0) @binding(0) var<storage, read> partials: array<f32>;
@group(0) @binding(1) var<storage, read_write> v_weights: array<f32>;

const ROWS: u32 = 8u;

var<workgroup> sums: array<f32, 256>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let weight = wid.x * 32u + local % 32u;
    var sum = 0.0;
    if weight < params.count {
        for (var row = local / 32u; row < params.groups; row += ROWS) {
            sum += partials[row * params.count + weight];
        }
    }
    sums[local] = sum;
    workgroupBarrier();
    if local < 32u && weight < params.count {
        var total = 0.0;
        for (var row = 0u; row < ROWS; row++) {
            total += sums[row * 32u + local];
        }
        v_weights[select(params.rest + weight - params.first, weight, weight < params.first)] = total;
    }
}
