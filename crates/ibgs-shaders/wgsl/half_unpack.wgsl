//! Gradients in half precision to planes.
#set matrix
#stage unet backward
// One thread a pixel: scaled gradients in half precision, channels last, to planes in float32.
#import index

/// Gradients in half precision to planes.
struct HalfUnpackParams {
    /// Number of pixels.
    pixels: u32,
    /// First channel.
    first: u32,
    /// Number of channels from there on, and of planes.
    channels: u32,
    /// Values a pixel with padding, divided by 4.
    quads: u32,
    /// Inverse of the gradients' scale.
    unscale: f32,
    /// Padding.
    pad: u32,
    /// Padding.
    pads: vec2<u32>,
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
    for (var k = 0u; k < params.channels; k++) {
        let channel = params.first + k;
        planes[k * params.pixels + p] = params.unscale * f32(packed[p * params.quads + channel / 4u][channel % 4u]);
    }
}
