//! Gradient of the enlargement by nearest.
#set train
#stage unet backward
// One thread a value before the enlargement: the sum of the gradients of its copies takes the value's place where its own
// ReLU lets it pass.
#import index

/// Gradient of the enlargement.
struct UpsampleParams {
    /// Size after the enlargement in pixels.
    size: vec2<u32>,
    /// Size before it.
    source: vec2<u32>,
    /// Channels.
    channels: u32,
    /// Padding.
    pad: u32,
}

var<immediate> params: UpsampleParams;

@group(0) @binding(0) var<storage, read> v_enlarged: array<f32>;
/// Activation in, gradient out.
@group(0) @binding(1) var<storage, read_write> v: array<f32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_workgroup(wid, groups) * 256u + local;
    let plane = params.source.x * params.source.y;
    if i >= params.channels * plane {
        return;
    }
    let at = vec2(i % params.source.x, (i % plane) / params.source.x);
    // Targets t with floor(t source / size) = at.
    let first = (at * params.size + params.source - 1u) / params.source;
    let end = ((at + 1u) * params.size + params.source - 1u) / params.source;
    var sum = 0.0;
    for (var y = first.y; y < end.y; y++) {
        for (var x = first.x; x < end.x; x++) {
            sum += v_enlarged[((i / plane) * params.size.y + y) * params.size.x + x];
        }
    }
    v[i] = select(0.0, sum, v[i] > 0.0);
}
