//! 3 x 3 convolution on the matrix units, forward or gradient by the input.
#set matrix
#stage unet
// A 3 x 3 convolution with zero padding on the matrix units, over one or two inputs (two: a concatenation that is never
// stored), or with weights packed for it the gradient by the input; channels last in half precision, sums in float32
// (method.md section 6).
//
// A workgroup of six subgroups makes SIDE columns x 16 rows x 3 SIDE outputs; a subgroup eight rows by SIDE outputs: eight
// accumulators, a row's pixels each. The tile passes through workgroup memory SIDE input channels at a time. A subgroup's ten rows
// of it serve all three rows of taps. Weights are read as whole matrices, [input channels / SIDE][tap][outputs / SIDE][output]
// [input], from storage: all workgroups read the same few, and workgroup memory for them would leave room for fewer workgroups.
#import half
#import half_conv_tile

/// A 3 x 3 convolution on the matrix units.
struct HalfConvParams {
    /// Size of the output in pixels.
    size: vec2<u32>,
    /// Size of what input a is read from.
    source: vec2<u32>,
    /// As [`ConvParams::mode`].
    mode: u32,
    /// Values a pixel of input a, with padding, divided by 8.
    pairs_a: u32,
    /// The same of input b; 0: there is none.
    pairs_b: u32,
    /// Values a pixel of the output, with padding, divided by 4.
    quads_out: u32,
    /// Output channels.
    outputs: u32,
    /// First bias.
    bias: u32,
    /// Where the packed weights begin, in groups of 4.
    packed: u32,
    /// Groups of SIDE outputs of the packed weights.
    packed_groups: u32,
    /// As [`ConvParams::store`].
    store: u32,
    /// Padding.
    pad: u32,
}

var<immediate> params: HalfConvParams;

@group(0) @binding(0) var<storage, read> weights: array<f32>;
@group(0) @binding(1) var<storage, read> packed: array<vec4<f16>>;
@group(0) @binding(2) var<storage, read> input_a: array<Pair>;
@group(0) @binding(3) var<storage, read> input_b: array<Pair>;
@group(0) @binding(4) var<storage, read_write> output: array<vec4<f16>>;

const SUBGROUPS: u32 = 6u;
const THREADS: u32 = SUBGROUPS * LANES;
const ROWS: u32 = HALF_CONV_ROWS + 2u;
const COLUMNS: u32 = SIDE + 2u;
// Groups of 4 channels, and of 8, that pass at a time, and distances in workgroup memory; the padding avoids bank conflicts.
const QUADS: u32 = SIDE / 4u;
const PAIRS: u32 = SIDE / 8u;
const PIXEL: u32 = QUADS + 2u;
const LINE: u32 = COLUMNS * PIXEL;
const SUMS: u32 = QUADS + 1u;
// A matrix of weights.
const MATRIX: u32 = SIDE * QUADS;
// Pixels that the workgroup loads, or a subgroup stores, in one step.
const PIXELS: u32 = THREADS / PAIRS;
const OUT_PIXELS: u32 = LANES / QUADS;
const NOWHERE: u32 = 0xffffffffu;
// A lane stores two pixels of a row.
const_assert 2u * OUT_PIXELS >= SIDE;

// [row][column][channels].
var<workgroup> tile: array<vec4<f16>, ROWS * LINE>;
// A matrix of sums of each subgroup: [subgroup][pixel][outputs].
var<workgroup> sums: array<vec4<f32>, SUBGROUPS * SIDE * SUMS>;

fn bias(o: u32) -> f32 {
    let wanted = params.store == STORE_RELU && o < params.outputs;
    return select(0.0, weights[select(0u, params.bias + o, wanted)], wanted);
}

fn biases(o: u32) -> vec4<f32> {
    return vec4(bias(o), bias(o + 1u), bias(o + 2u), bias(o + 3u));
}

fn finish(sum: vec4<f32>, old: vec4<f16>) -> vec4<f16> {
    var v = sum;
    if params.store == STORE_RELU {
        v = max(v, vec4(0.0));
    } else if params.store == STORE_ADD {
        v += vec4<f32>(old);
    } else if params.store == STORE_MASK {
        v = select(vec4(0.0), v, old > vec4<f16>());
    }
    return to_half(v);
}

// Where a lane's group of 4 outputs of a pixel goes; past the output's end where there is none.
fn goal(x: u32, y: u32, q: u32) -> u32 {
    let inside = x < params.size.x && y < params.size.y && q < params.quads_out;
    return select(NOWHERE, (y * params.size.x + x) * params.quads_out + q, inside);
}

@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let subgroup = local / LANES;
    let lane = local % LANES;
    let origin = vec2<i32>(wid.xy * vec2(SIDE, HALF_CONV_ROWS));
    let first_row = 8u * (subgroup % 2u);
    let group = 3u * wid.z + subgroup / 2u;
    #repeat r 8
    var c$r = MatrixC();
    #end
    let own_q = lane % QUADS;
    let q = group * QUADS + own_q;
    let add = biases(4u * q);
    let taps_row = 3u * params.packed_groups * MATRIX;
    let chunks = (params.pairs_a + params.pairs_b) / PAIRS;
    for (var n = 0u; n < chunks; n++) {
        load_tile(local, origin, n);
        for (var column = 0u; column < 3u; column++) {
            let at = first_row * LINE + column * PIXEL;
            #repeat r 10
            let a$r = coopLoadT<MatrixA>(&tile[at + $ru * LINE], PIXEL);
            #end
            var k = params.packed + ((9u * n + column) * params.packed_groups + group) * MATRIX;
            let b0 = coopLoad<MatrixB>(&packed[k], QUADS);
            c0 = coopMultiplyAdd(a0, b0, c0);
            c1 = coopMultiplyAdd(a1, b0, c1);
            c2 = coopMultiplyAdd(a2, b0, c2);
            c3 = coopMultiplyAdd(a3, b0, c3);
            c4 = coopMultiplyAdd(a4, b0, c4);
            c5 = coopMultiplyAdd(a5, b0, c5);
            c6 = coopMultiplyAdd(a6, b0, c6);
            c7 = coopMultiplyAdd(a7, b0, c7);
            k += taps_row;
            let b1 = coopLoad<MatrixB>(&packed[k], QUADS);
            c0 = coopMultiplyAdd(a1, b1, c0);
            c1 = coopMultiplyAdd(a2, b1, c1);
            c2 = coopMultiplyAdd(a3, b1, c2);
            c3 = coopMultiplyAdd(a4, b1, c3);
            c4 = coopMultiplyAdd(a5, b1, c4);
            c5 = coopMultiplyAdd(a6, b1, c5);
            c6 = coopMultiplyAdd(a7, b1, c6);
            c7 = coopMultiplyAdd(a8, b1, c7);
            k += taps_row;
            let b2 = coopLoad<MatrixB>(&packed[k], QUADS);
            c0 = coopMultiplyAdd(a2, b2, c0);
            c1 = coopMultiplyAdd(a3, b2, c1);
            c2 = coopMultiplyAdd(a4, b2, c2);
            c3 = coopMultiplyAdd(a5, b2, c3);
            c4 = coopMultiplyAdd(a6, b2, c4);
            c5 = coopMultiplyAdd(a7, b2, c5);
            c6 = coopMultiplyAdd(a8, b2, c6);
            c7 = coopMultiplyAdd(a9, b2, c7);
        }
    }
    let x = u32(origin.x);
    let y = u32(origin.y) + first_row;
    let own = subgroup * SIDE * SUMS;
    let last = params.size.x * params.size.y * params.quads_out - 1u;
    let left = lane / QUADS;
    let right = left + OUT_PIXELS;
    // Output positions of the lane's two pixels of each row, and the values that the sums are added to or masked by.
    #repeat r 8
    let goal_left$r = goal(x + left, y + $ru, q);
    let goal_right$r = goal(x + right, y + $ru, q);
    var old_left$r = vec4<f16>();
    var old_right$r = vec4<f16>();
    #end
    if params.store >= STORE_ADD {
        #repeat r 8
        old_left$r = output[min(goal_left$r, last)];
        old_right$r = output[min(goal_right$r, last)];
        #end
    }
    // A subgroup reads no other's sums.
    #repeat r 8
    coopStoreT(c$r, &sums[own], SUMS);
    subgroupBarrier();
    if goal_left$r != NOWHERE {
        output[goal_left$r] = finish(sums[own + left * SUMS + own_q] + add, old_left$r);
    }
    if goal_right$r != NOWHERE {
        output[goal_right$r] = finish(sums[own + right * SUMS + own_q] + add, old_right$r);
    }
    subgroupBarrier();
    #end
}
