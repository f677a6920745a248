//! Rows of partial sums into the flat weight gradient.
#set train
#stage unet weights
// Adds the rows of partial sums in a fixed order and puts the result where the layer's weights and biases lie.
#import index

/// Sum of rows of partial sums.
struct SumParams {
    /// Rows.
    splits: u32,
    /// Values a row.
    stride: u32,
    /// Outputs of the layer: the first `rows * length` values of a row are weights.
    rows: u32,
    /// Weights of an output.
    length: u32,
    /// Where the first output's weights go.
    target_offset: u32,
    /// Distance to the next output's.
    target_stride: u32,
    /// Where the biases go.
    bias: u32,
    /// How many of them are wanted.
    biases: u32,
}

var<immediate> params: SumParams;

@group(0) @binding(0) var<storage, read> partials: array<f32>;
@group(0) @binding(1) var<storage, read_write> sums: array<f32>;

// 32 values x 8 parts of the rows.
var<workgroup> parts: array<f32, 256>;

fn partial(row: u32, i: u32) -> f32 {
    let inside = row < params.splits;
    return select(0.0, partials[select(0u, row * params.stride + i, inside)], inside);
}

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_workgroup(wid, groups) * 32u + local % 32u;
    let weights = params.rows * params.length;
    let wanted = i < weights + params.biases;
    var sum = 0.0;
    if wanted {
        for (var row = local / 32u; row < params.splits; row += 32u) {
            sum += (partial(row, i) + partial(row + 8u, i)) + (partial(row + 16u, i) + partial(row + 24u, i));
        }
    }
    parts[local] = sum;
    workgroupBarrier();
    if local >= 32u || !wanted {
        return;
    }
    for (var part = 1u; part < 8u; part++) {
        sum += parts[part * 32u + local];
    }
    if i < weights {
        sums[params.target_offset + (i / params.length) * params.target_stride + i % params.length] = sum;
    } else {
        sums[params.bias + i - weights] = sum;
    }
}
