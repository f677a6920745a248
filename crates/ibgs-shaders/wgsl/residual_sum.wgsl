// Adds the rows of partial sums in a fixed order and puts the result where the layer's weights and biases lie.
#import index

struct SumParams {
    // Rows of partial sums, and values a row.
    splits: u32,
    stride: u32,
    // The first `rows * length` values of a row are weights: `length` for each output.
    rows: u32,
    length: u32,
    // Where the first output's go, and the distance to the next output's.
    target_offset: u32,
    target_stride: u32,
    // Where the values behind the weights go, and how many are wanted.
    bias: u32,
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
