//! Gradient of the enlargement by nearest in half precision.
#set matrix
#stage unet backward
// As residual_upsample_backward in half precision, channels last: one thread four channels of a pixel before the enlargement.
#import half_resize

@group(0) @binding(0) var<storage, read> v_enlarged: array<vec4<f16>>;
/// Activation in, gradient out.
@group(0) @binding(1) var<storage, read_write> v: array<vec4<f16>>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_workgroup(wid, groups) * 256u + local;
    if i >= params.source.x * params.source.y * params.quads {
        return;
    }
    let q = i % params.quads;
    let at = vec2((i / params.quads) % params.source.x, i / (params.quads * params.source.x));
    // Targets t with floor(t source / size) = at.
    let first = (at * params.size + params.source - 1u) / params.source;
    let end = ((at + 1u) * params.size + params.source - 1u) / params.source;
    var sum = vec4(0.0);
    for (var y = first.y; y < end.y; y++) {
        for (var x = first.x; x < end.x; x++) {
            sum += vec4<f32>(v_enlarged[(y * params.size.x + x) * params.quads + q]);
        }
    }
    v[i] = to_half(select(vec4(0.0), sum, v[i] > vec4<f16>()));
}
