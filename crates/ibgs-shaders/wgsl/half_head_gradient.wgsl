//! Gradient by the input of the U-Net's last layer.
#set matrix
#stage unet backward
// One thread four channels of a pixel, so that neighbours write side by side: the scaled gradient by the output in half precision,
// and the gradient by f through the last layer and the ReLU of f.
#import half
#import index

/// Gradient by the last layer's input.
struct HalfHeadGradientParams {
    /// Number of pixels.
    pixels: u32,
    /// First weight of the last layer.
    last: u32,
    /// Gradients are multiplied by this, so that halves hold them.
    scale: f32,
}

var<immediate> params: HalfHeadGradientParams;

@group(0) @binding(0) var<storage, read> weights: array<f32>;
@group(0) @binding(1) var<storage, read> v_residual: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> f: array<vec4<f16>>;
/// Channels last, padded to 16.
@group(0) @binding(3) var<storage, read_write> v_out: array<vec4<f16>>;
/// Channels last, padded to 48.
@group(0) @binding(4) var<storage, read_write> v_f: array<vec4<f16>>;

const WIDTH: u32 = NETWORK_CHANNELS;
const QUADS: u32 = 12u;

var<workgroup> last: array<array<vec4<f32>, QUADS>, NETWORK_OUTPUTS>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    if local < NETWORK_OUTPUTS * 4u * QUADS {
        let o = local % (4u * QUADS);
        let w = select(0.0, weights[params.last + (local / (4u * QUADS)) * WIDTH + min(o, WIDTH - 1u)], o < WIDTH);
        last[local / (4u * QUADS)][o / 4u][o % 4u] = w;
    }
    workgroupBarrier();
    let k = linear_workgroup(wid, groups) * 256u + local;
    let p = k / QUADS;
    let q = k % QUADS;
    if p >= params.pixels {
        return;
    }
    let v = params.scale * v_residual[p];
    if q < 4u {
        v_out[4u * p + q] = to_half(select(vec4(0.0), v, q == 0u));
    }
    let sum = last[0][q] * v.x + last[1][q] * v.y + last[2][q] * v.z + last[3][q] * v.w;
    v_f[k] = to_half(select(vec4(0.0), sum, f[k] > vec4<f16>()));
}
