// A 3 x 3 convolution with zero padding on the matrix units, over one or two inputs (two: a concatenation that is never
// stored), or with weights packed for it the gradient by the input; channels last in half precision, sums in float32
// (method.md section 6).
//
// A workgroup of four subgroups makes SIDE columns x 16 rows x 3 SIDE outputs; a subgroup four rows: twelve accumulators, a
// row's pixels by SIDE outputs each. Tile and weights pass through workgroup memory SIDE input channels at a time. A
// subgroup's six rows of the tile serve all three rows of taps.
#import half
#import residual_source

struct HalfConvParams {
    // Size of the output, and of what input a is read from.
    size: vec2<u32>,
    source: vec2<u32>,
    mode: u32,
    // Values a pixel, with padding, divided by 4: of input a, of input b (0: there is none), of the output.
    quads_a: u32,
    quads_b: u32,
    quads_out: u32,
    outputs: u32,
    // First bias.
    bias: u32,
    // Where the packed weights begin, and those of one input channel and tap, in groups of 4.
    packed: u32,
    packed_quads: u32,
    // What becomes of the sums.
    store: u32,
    pad: u32,
}

// Adds the bias and cuts off below zero.
const RELU: u32 = 0u;
// Assigns.
const ASSIGN: u32 = 1u;
// Adds to what is there.
const ADD: u32 = 2u;
// The output holds the activation whose gradient this is; the gradient takes its place where it is positive.
const MASK: u32 = 3u;

var<immediate> params: HalfConvParams;

@group(0) @binding(0) var<storage, read> weights: array<f32>;
@group(0) @binding(1) var<storage, read> packed: array<vec4<f16>>;
@group(0) @binding(2) var<storage, read> input_a: array<vec4<f16>>;
@group(0) @binding(3) var<storage, read> input_b: array<vec4<f16>>;
@group(0) @binding(4) var<storage, read_write> output: array<vec4<f16>>;

const THREADS: u32 = 4u * LANES;
const ROWS: u32 = 18u;
const COLUMNS: u32 = SIDE + 2u;
// Groups of 4 channels that pass at a time, and distances in workgroup memory; the padding avoids bank conflicts.
const QUADS: u32 = SIDE / 4u;
const PIXEL: u32 = QUADS + 2u;
const LINE: u32 = COLUMNS * PIXEL;
const CHANNEL: u32 = 3u * QUADS + 2u;
const SUMS: u32 = QUADS + 1u;

// [row][column][channels].
var<workgroup> tile: array<vec4<f16>, ROWS * LINE>;
// [tap][input channel][outputs].
var<workgroup> kernel: array<vec4<f16>, 9u * SIDE * CHANNEL>;
// A matrix of sums of each subgroup.
var<workgroup> sums: array<vec4<f32>, 4u * SIDE * SUMS>;

fn read_a(at: u32) -> vec4<f16> {
    if params.mode == POOLED {
        let right = params.quads_a;
        let below = params.source.x * params.quads_a;
        return max(max(input_a[at], input_a[at + right]), max(input_a[at + below], input_a[at + below + right]));
    }
    return input_a[at];
}

fn load_tile(local: u32, origin: vec2<i32>, second: bool, first: u32) {
    let quads = select(params.quads_a, params.quads_b, second);
    for (var k = local; k < ROWS * COLUMNS * QUADS; k += THREADS) {
        let q = k % QUADS;
        let column = (k / QUADS) % COLUMNS;
        let row = k / (QUADS * COLUMNS);
        // Input b always has the size of the output.
        let mode = select(params.mode, SAME, second);
        let source = select(params.source, params.size, second);
        let x = source_of(origin.x + i32(column) - 1, params.size.x, source.x, mode);
        let y = source_of(origin.y + i32(row) - 1, params.size.y, source.y, mode);
        var v = vec4<f16>();
        if x >= 0 && y >= 0 && first + q < quads {
            let at = (u32(y) * source.x + u32(x)) * quads + first + q;
            if second {
                v = input_b[at];
            } else {
                v = read_a(at);
            }
        }
        tile[row * LINE + column * PIXEL + q] = v;
    }
}

// `chunk` counts SIDE channels of both inputs together.
fn load_kernel(local: u32, chunk: u32, group: u32) {
    let padded = 4u * (params.quads_a + params.quads_b);
    for (var k = local; k < 9u * SIDE * 3u * QUADS; k += THREADS) {
        let q = k % (3u * QUADS);
        let i = k / (3u * QUADS);
        let row = (i / SIDE) * padded + chunk * SIDE + i % SIDE;
        kernel[i * CHANNEL + q] = packed[params.packed + row * params.packed_quads + group * 3u * QUADS + q];
    }
}

fn bias(o: u32) -> f32 {
    let wanted = params.store == RELU && o < params.outputs;
    return select(0.0, weights[select(0u, params.bias + o, wanted)], wanted);
}

// Every row of a subgroup's sums becomes the biases of SIDE outputs.
fn put_bias(subgroup: u32, lane: u32, o: u32) {
    workgroupBarrier();
    for (var k = lane; k < SIDE * QUADS; k += LANES) {
        let c = o + 4u * (k % QUADS);
        sums[subgroup * SIDE * SUMS + (k / QUADS) * SUMS + k % QUADS] =
            vec4(bias(c), bias(c + 1u), bias(c + 2u), bias(c + 3u));
    }
    workgroupBarrier();
}

fn finish(sum: vec4<f32>, at: u32) -> vec4<f16> {
    var v = sum;
    if params.store == RELU {
        v = max(v, vec4(0.0));
    } else if params.store == ADD {
        v += vec4<f32>(output[at]);
    } else if params.store == MASK {
        v = select(vec4(0.0), v, output[at] > vec4<f16>());
    }
    return to_half(v);
}

// A subgroup's sums into the output: SIDE pixels from (x, y) on, group `q` of 4 outputs and on.
fn store(subgroup: u32, lane: u32, x: u32, y: u32, q: u32) {
    workgroupBarrier();
    for (var k = lane; k < SIDE * QUADS; k += LANES) {
        let pixel = x + k / QUADS;
        let at = q + k % QUADS;
        if pixel < params.size.x && y < params.size.y && at < params.quads_out {
            let i = (y * params.size.x + pixel) * params.quads_out + at;
            output[i] = finish(sums[subgroup * SIDE * SUMS + (k / QUADS) * SUMS + k % QUADS], i);
        }
    }
    workgroupBarrier();
}

@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let subgroup = local / LANES;
    let lane = local % LANES;
    let origin = vec2<i32>(wid.xy * vec2(SIDE, 16u));
    let own = subgroup * SIDE * SUMS;
    let o = wid.z * 3u * SIDE;
    put_bias(subgroup, lane, o);
    var c00 = coopLoadT<MatrixC>(&sums[own], SUMS);
    var c10 = c00;
    var c20 = c00;
    var c30 = c00;
    put_bias(subgroup, lane, o + SIDE);
    var c01 = coopLoadT<MatrixC>(&sums[own], SUMS);
    var c11 = c01;
    var c21 = c01;
    var c31 = c01;
    put_bias(subgroup, lane, o + 2u * SIDE);
    var c02 = coopLoadT<MatrixC>(&sums[own], SUMS);
    var c12 = c02;
    var c22 = c02;
    var c32 = c02;
    let chunks_a = params.quads_a / QUADS;
    let chunks = chunks_a + params.quads_b / QUADS;
    for (var n = 0u; n < chunks; n++) {
        let second = n >= chunks_a;
        workgroupBarrier();
        load_tile(local, origin, second, QUADS * select(n, n - chunks_a, second));
        load_kernel(local, n, wid.z);
        workgroupBarrier();
        for (var column = 0u; column < 3u; column++) {
            let at = 4u * subgroup * LINE + column * PIXEL;
            let a0 = coopLoadT<MatrixA>(&tile[at], PIXEL);
            let a1 = coopLoadT<MatrixA>(&tile[at + LINE], PIXEL);
            let a2 = coopLoadT<MatrixA>(&tile[at + 2u * LINE], PIXEL);
            let a3 = coopLoadT<MatrixA>(&tile[at + 3u * LINE], PIXEL);
            let a4 = coopLoadT<MatrixA>(&tile[at + 4u * LINE], PIXEL);
            let a5 = coopLoadT<MatrixA>(&tile[at + 5u * LINE], PIXEL);
            var k = column * SIDE * CHANNEL;
            let u0 = coopLoadT<MatrixB>(&kernel[k], CHANNEL);
            let u1 = coopLoadT<MatrixB>(&kernel[k + QUADS], CHANNEL);
            let u2 = coopLoadT<MatrixB>(&kernel[k + 2u * QUADS], CHANNEL);
            c00 = coopMultiplyAdd(a0, u0, c00);
            c10 = coopMultiplyAdd(a1, u0, c10);
            c20 = coopMultiplyAdd(a2, u0, c20);
            c30 = coopMultiplyAdd(a3, u0, c30);
            c01 = coopMultiplyAdd(a0, u1, c01);
            c11 = coopMultiplyAdd(a1, u1, c11);
            c21 = coopMultiplyAdd(a2, u1, c21);
            c31 = coopMultiplyAdd(a3, u1, c31);
            c02 = coopMultiplyAdd(a0, u2, c02);
            c12 = coopMultiplyAdd(a1, u2, c12);
            c22 = coopMultiplyAdd(a2, u2, c22);
            c32 = coopMultiplyAdd(a3, u2, c32);
            k += 3u * SIDE * CHANNEL;
            let v0 = coopLoadT<MatrixB>(&kernel[k], CHANNEL);
            let v1 = coopLoadT<MatrixB>(&kernel[k + QUADS], CHANNEL);
            let v2 = coopLoadT<MatrixB>(&kernel[k + 2u * QUADS], CHANNEL);
            c00 = coopMultiplyAdd(a1, v0, c00);
            c10 = coopMultiplyAdd(a2, v0, c10);
            c20 = coopMultiplyAdd(a3, v0, c20);
            c30 = coopMultiplyAdd(a4, v0, c30);
            c01 = coopMultiplyAdd(a1, v1, c01);
            c11 = coopMultiplyAdd(a2, v1, c11);
            c21 = coopMultiplyAdd(a3, v1, c21);
            c31 = coopMultiplyAdd(a4, v1, c31);
            c02 = coopMultiplyAdd(a1, v2, c02);
            c12 = coopMultiplyAdd(a2, v2, c12);
            c22 = coopMultiplyAdd(a3, v2, c22);
            c32 = coopMultiplyAdd(a4, v2, c32);
            k += 3u * SIDE * CHANNEL;
            let w0 = coopLoadT<MatrixB>(&kernel[k], CHANNEL);
            let w1 = coopLoadT<MatrixB>(&kernel[k + QUADS], CHANNEL);
            let w2 = coopLoadT<MatrixB>(&kernel[k + 2u * QUADS], CHANNEL);
            c00 = coopMultiplyAdd(a2, w0, c00);
            c10 = coopMultiplyAdd(a3, w0, c10);
            c20 = coopMultiplyAdd(a4, w0, c20);
            c30 = coopMultiplyAdd(a5, w0, c30);
            c01 = coopMultiplyAdd(a2, w1, c01);
            c11 = coopMultiplyAdd(a3, w1, c11);
            c21 = coopMultiplyAdd(a4, w1, c21);
            c31 = coopMultiplyAdd(a5, w1, c31);
            c02 = coopMultiplyAdd(a2, w2, c02);
            c12 = coopMultiplyAdd(a3, w2, c12);
            c22 = coopMultiplyAdd(a4, w2, c22);
            c32 = coopMultiplyAdd(a5, w2, c32);
        }
    }
    let x = u32(origin.x);
    let y = u32(origin.y) + 4u * subgroup;
    let q = wid.z * 3u * QUADS;
    coopStoreT(c00, &sums[own], SUMS);
    store(subgroup, lane, x, y, q);
    coopStoreT(c01, &sums[own], SUMS);
    store(subgroup, lane, x, y, q + QUADS);
    coopStoreT(c02, &sums[own], SUMS);
    store(subgroup, lane, x, y, q + 2u * QUADS);
    coopStoreT(c10, &sums[own], SUMS);
    store(subgroup, lane, x, y + 1u, q);
    coopStoreT(c11, &sums[own], SUMS);
    store(subgroup, lane, x, y + 1u, q + QUADS);
    coopStoreT(c12, &sums[own], SUMS);
    store(subgroup, lane, x, y + 1u, q + 2u * QUADS);
    coopStoreT(c20, &sums[own], SUMS);
    store(subgroup, lane, x, y + 2u, q);
    coopStoreT(c21, &sums[own], SUMS);
    store(subgroup, lane, x, y + 2u, q + QUADS);
    coopStoreT(c22, &sums[own], SUMS);
    store(subgroup, lane, x, y + 2u, q + 2u * QUADS);
    coopStoreT(c30, &sums[own], SUMS);
    store(subgroup, lane, x, y + 3u, q);
    coopStoreT(c31, &sums[own], SUMS);
    store(subgroup, lane, x, y + 3u, q + QUADS);
    coopStoreT(c32, &sums[own], SUMS);
    store(subgroup, lane, x, y + 3u, q + 2u * QUADS);
}
