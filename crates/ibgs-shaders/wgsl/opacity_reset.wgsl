//! Opacity clamped from above.
#set train
#stage other
// One thread a Gaussian: opacity clamped from above (method.md section 7).
#import index

/// Opacity reset.
struct OpacityResetParams {
    /// Number of Gaussians.
    count: u32,
    /// The logit that no opacity may exceed.
    limit: f32,
}

var<immediate> params: OpacityResetParams;

@group(0) @binding(0) var<storage, read_write> opacity_logits: array<f32>;

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
    opacity_logits[i] = min(opacity_logits[i], params.limit);
}
