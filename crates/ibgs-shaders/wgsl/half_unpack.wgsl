//! Gradients in half precision to planes.
#set matrix
#stage unet backward
// One thread a pixel: scaled gradients in half precision, channels last, to planes in float32.
#import index

/// Gradients in half precision to planes.
struct HalfUnpackParams {
    /// Number of pixels.
    pixels: u32,
    /// Number of planes.
    channels: u32,
    /// Values a pixel with padding, divided by 4.
    quads: u32,
    /// Inverse of the gradients' scale.
    unscale: f32,
}

var<immediate> params: HalfUnpackParams;

@group(0) @binding(0) var<storage, read> packed: array<vec4<f16>>;
@group(0) @binding(1) var<storage, read_write> planes: array<f32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let p = linear_workgroup(wid, groups) * 256u + local;
    if p >= params.pixels {
        return;
    }
    for (var q = 0u; 4u * q < params.channels; q++) {
        let v = params.unscale * vec4<f32>(packed[p * params.quads + q]);
        for (var k = 0u; k < min(4u, params.channels - 4u * q); k++) {
            planes[(4u * q + k) * params.pixels + p] = v[k];
        }
    }
}
