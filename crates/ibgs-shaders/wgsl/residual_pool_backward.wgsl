//! Gradient of the 2 x 2 maximum.
#set train
#stage unet backward
// One thread a value before the 2 x 2 maximum: adds the gradient of the maximum where the value is the first largest of
// its window, then passes the whole through the value's own ReLU.
#import index

/// Gradient of the 2 x 2 maximum.
struct PoolParams {
    /// Size before the maximum in pixels.
    size: vec2<u32>,
    /// Channels.
    channels: u32,
    /// Padding.
    pad: u32,
}

var<immediate> params: PoolParams;

@group(0) @binding(0) var<storage, read> activation: array<f32>;
@group(0) @binding(1) var<storage, read> v_pooled: array<f32>;
@group(0) @binding(2) var<storage, read_write> v: array<f32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_workgroup(wid, groups) * 256u + local;
    let plane = params.size.x * params.size.y;
    if i >= params.channels * plane {
        return;
    }
    let value = activation[i];
    if value <= 0.0 {
        v[i] = 0.0;
        return;
    }
    let x = i % params.size.x;
    let y = (i % plane) / params.size.x;
    let pooled = params.size / 2u;
    if x / 2u >= pooled.x || y / 2u >= pooled.y {
        return;
    }
    let first = i - (y % 2u) * params.size.x - x % 2u;
    let mine = 2u * (y % 2u) + x % 2u;
    var largest = true;
    for (var k = 0u; k < 4u; k++) {
        let other = activation[first + (k / 2u) * params.size.x + k % 2u];
        largest = largest && select(value >= other, value > other, k < mine);
    }
    if largest {
        v[i] += v_pooled[((i / plane) * pooled.y + y / 2u) * pooled.x + x / 2u];
    }
}
