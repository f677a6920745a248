//! Gradient of the 2 x 2 maximum in half precision.
#set matrix
#stage unet backward
// As residual_pool_backward in half precision, channels last: one thread four channels of a pixel before the maximum.
#import half_resize

@group(0) @binding(0) var<storage, read> activation: array<vec4<f16>>;
@group(0) @binding(1) var<storage, read> v_pooled: array<vec4<f16>>;
@group(0) @binding(2) var<storage, read_write> v: array<vec4<f16>>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_workgroup(wid, groups) * 256u + local;
    if i >= params.size.x * params.size.y * params.quads {
        return;
    }
    let q = i % params.quads;
    let x = (i / params.quads) % params.size.x;
    let y = i / (params.quads * params.size.x);
    let value = activation[i];
    let open = value > vec4<f16>();
    var sum = vec4<f32>(v[i]);
    if x / 2u < params.source.x && y / 2u < params.source.y {
        let first = ((y - y % 2u) * params.size.x + x - x % 2u) * params.quads + q;
        let mine = 2u * (y % 2u) + x % 2u;
        var largest = vec4(true);
        for (var k = 0u; k < 4u; k++) {
            let other = activation[first + ((k / 2u) * params.size.x + k % 2u) * params.quads];
            largest = largest & select(value >= other, value > other, vec4(k < mine));
        }
        let pooled = vec4<f32>(v_pooled[((y / 2u) * params.source.x + x / 2u) * params.quads + q]);
        sum += select(vec4(0.0), pooled, largest);
    }
    v[i] = to_half(select(vec4(0.0), sum, open));
}
