//! Rows of the matrix units' partial sums into the flat weight gradient.
#set matrix
#stage unet weights
// Adds the partial sums of a layer's weight gradient in a fixed order, takes the scale back, and puts the result where the
// layer's weights and biases lie.
#import index

/// Sum of rows of the partial sums of matrix units.
struct HalfSumParams {
    /// Rows.
    splits: u32,
    /// Groups of 3 SIDE input channels.
    groups_in: u32,
    /// Groups of 3 SIDE output channels.
    groups_out: u32,
    /// 9 or 1.
    taps: u32,
    /// Input channels.
    inputs: u32,
    /// Output channels.
    outputs: u32,
    /// Where the first weight's gradient goes.
    into: u32,
    /// Distance to the next output's.
    stride: u32,
    /// Where the biases' go; 0: nowhere.
    bias: u32,
    /// Inverse of the gradients' scale.
    unscale: f32,
}

var<immediate> params: HalfSumParams;

@group(0) @binding(0) var<storage, read> partials: array<f32>;
@group(0) @binding(1) var<storage, read_write> sums: array<f32>;

const LINE: u32 = 3u * SIDE;

// 32 values x 8 parts of the rows.
var<workgroup> parts: array<f32, 256>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let length = params.groups_in * params.groups_out * params.taps * LINE * LINE;
    let k = linear_workgroup(wid, groups) * 32u + local % 32u;
    var sum = 0.0;
    if k < length {
        for (var row = local / 32u; row < params.splits; row += 8u) {
            sum += partials[row * length + k];
        }
    }
    parts[local] = sum;
    workgroupBarrier();
    if local >= 32u || k >= length {
        return;
    }
    for (var part = 1u; part < 8u; part++) {
        sum += parts[part * 32u + local];
    }
    let block = k / (LINE * LINE);
    let tap = block % params.taps;
    let group = block / params.taps;
    let i = (group / params.groups_out) * LINE + (k / LINE) % LINE;
    let o = (group % params.groups_out) * LINE + k % LINE;
    if o >= params.outputs {
        return;
    }
    if i < params.inputs {
        sums[params.into + o * params.stride + i * params.taps + tap] = sum * params.unscale;
    } else if i == params.inputs && tap == params.taps / 2u && params.bias > 0u {
        sums[params.bias + o] = sum * params.unscale;
    }
}
