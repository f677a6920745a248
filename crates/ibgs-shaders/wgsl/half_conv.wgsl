// A 3 x 3 convolution with zero padding on the matrix units, over one or two inputs (two: a concatenation that is never
// stored), or with weights packed for it the gradient by the input; channels last in half precision, sums in float32
// (method.md section 6).
//
// A workgroup of four subgroups makes SIDE columns x 16 rows x 3 SIDE outputs; a subgroup four rows: twelve accumulators, a
// row's pixels by SIDE outputs each. The tile passes through workgroup memory SIDE input channels at a time. A subgroup's six
// rows of the tile serve all three rows of taps. Weights are read as whole matrices, [input channels / SIDE][tap]
// [outputs / SIDE][output][input].
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
    // Where the packed weights begin, in groups of 4, and groups of SIDE outputs.
    packed: u32,
    packed_groups: u32,
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

// Subgroups of a workgroup.
const SUBGROUPS: u32 = 4u;
const THREADS: u32 = SUBGROUPS * LANES;
const ROWS: u32 = 4u * SUBGROUPS + 2u;
const COLUMNS: u32 = SIDE + 2u;
// Groups of 4 channels that pass at a time, and distances in workgroup memory; the padding avoids bank conflicts.
const QUADS: u32 = SIDE / 4u;
const PIXEL: u32 = QUADS + 2u;
const LINE: u32 = COLUMNS * PIXEL;
const OUTPUT: u32 = QUADS + 1u;
const MATRIX: u32 = SIDE * OUTPUT;
const SUMS: u32 = 3u * QUADS + 1u;
// Pixels that the workgroup, or a subgroup, takes in one step.
const PIXELS: u32 = THREADS / QUADS;
const OUT_PIXELS: u32 = LANES / QUADS;
const NOWHERE: u32 = 0xffffffffu;
// The repetitions below are enough.
const_assert 12u * PIXELS >= ROWS * COLUMNS;
const_assert 2u * OUT_PIXELS >= SIDE;
const_assert 14u * THREADS >= 27u * SIDE * QUADS;

// [row][column][channels].
var<workgroup> tile: array<vec4<f16>, ROWS * LINE>;
// [tap][outputs / SIDE][output][inputs].
var<workgroup> kernel: array<vec4<f16>, 27u * MATRIX>;
// Three matrices of sums of each subgroup: [subgroup][pixel][outputs].
var<workgroup> sums: array<vec4<f32>, SUBGROUPS * SIDE * SUMS>;

// Where a pixel of the tile lies in an input of `quads` groups of 4 channels, or outside of it.
struct Place {
    at: u32,
    inside: bool,
}

fn place(p: u32, origin: vec2<i32>, source: vec2<u32>, mode: u32, quads: u32) -> Place {
    let x = source_of(origin.x + i32(p % COLUMNS) - 1, params.size.x, source.x, mode);
    let y = source_of(origin.y + i32(p / COLUMNS) - 1, params.size.y, source.y, mode);
    let inside = x >= 0 && y >= 0;
    return Place(select(0u, (u32(y) * source.x + u32(x)) * quads, inside), inside);
}

fn read_b(p: u32, q: u32, origin: vec2<i32>) -> vec4<f16> {
    let spot = place(p, origin, params.size, SAME, params.quads_b);
    return select(vec4<f16>(), input_b[spot.at + q], spot.inside);
}

fn read_same(p: u32, q: u32, origin: vec2<i32>) -> vec4<f16> {
    let spot = place(p, origin, params.size, SAME, params.quads_a);
    return select(vec4<f16>(), input_a[spot.at + q], spot.inside);
}

fn read_nearest(p: u32, q: u32, origin: vec2<i32>) -> vec4<f16> {
    let spot = place(p, origin, params.source, NEAREST, params.quads_a);
    return select(vec4<f16>(), input_a[spot.at + q], spot.inside);
}

fn read_pooled(p: u32, q: u32, origin: vec2<i32>) -> vec4<f16> {
    let spot = place(p, origin, params.source, POOLED, params.quads_a);
    let at = spot.at + q;
    let below = at + params.source.x * params.quads_a;
    let upper = max(input_a[at], input_a[at + params.quads_a]);
    let lower = max(input_a[below], input_a[below + params.quads_a]);
    return select(vec4<f16>(), max(upper, lower), spot.inside);
}

fn put(p: u32, q: u32, v: vec4<f16>) {
    if p < ROWS * COLUMNS {
        tile[(p / COLUMNS) * LINE + (p % COLUMNS) * PIXEL + q] = v;
    }
}

// Channels `chunk` SIDE and on of both inputs together. The reads of all steps are under way together.
fn load_tile(local: u32, origin: vec2<i32>, chunk: u32) {
    let p = local / QUADS;
    let own = local % QUADS;
    let q = chunk * QUADS + own;
    if chunk * QUADS >= params.quads_a {
        #repeat n 12
        let v$n = read_b(p + $nu * PIXELS, q - params.quads_a, origin);
        #end
        #repeat n 12
        put(p + $nu * PIXELS, own, v$n);
        #end
    } else if params.mode == POOLED {
        #repeat n 12
        let v$n = read_pooled(p + $nu * PIXELS, q, origin);
        #end
        #repeat n 12
        put(p + $nu * PIXELS, own, v$n);
        #end
    } else if params.mode == NEAREST {
        #repeat n 12
        let v$n = read_nearest(p + $nu * PIXELS, q, origin);
        #end
        #repeat n 12
        put(p + $nu * PIXELS, own, v$n);
        #end
    } else {
        #repeat n 12
        let v$n = read_same(p + $nu * PIXELS, q, origin);
        #end
        #repeat n 12
        put(p + $nu * PIXELS, own, v$n);
        #end
    }
}

fn read_kernel(k: u32, chunk: u32, group: u32) -> vec4<f16> {
    let tap = k / (3u * SIDE * QUADS);
    return packed[params.packed + ((9u * chunk + tap) * params.packed_groups + 3u * group) * SIDE * QUADS
        + k % (3u * SIDE * QUADS)];
}

fn put_kernel(k: u32, v: vec4<f16>) {
    if k < 27u * SIDE * QUADS {
        kernel[(k / QUADS) * OUTPUT + k % QUADS] = v;
    }
}

fn load_kernel(local: u32, chunk: u32, group: u32) {
    #repeat n 14
    let v$n = read_kernel(local + $nu * THREADS, chunk, group);
    #end
    #repeat n 14
    put_kernel(local + $nu * THREADS, v$n);
    #end
}

fn bias(o: u32) -> f32 {
    let wanted = params.store == RELU && o < params.outputs;
    return select(0.0, weights[select(0u, params.bias + o, wanted)], wanted);
}

fn biases(o: u32) -> vec4<f32> {
    return vec4(bias(o), bias(o + 1u), bias(o + 2u), bias(o + 3u));
}

fn finish(sum: vec4<f32>, old: vec4<f16>) -> vec4<f16> {
    var v = sum;
    if params.store == RELU {
        v = max(v, vec4(0.0));
    } else if params.store == ADD {
        v += vec4<f32>(old);
    } else if params.store == MASK {
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
    let origin = vec2<i32>(wid.xy * vec2(SIDE, 4u * SUBGROUPS));
    var c00 = MatrixC();
    var c10 = MatrixC();
    var c20 = MatrixC();
    var c30 = MatrixC();
    var c01 = MatrixC();
    var c11 = MatrixC();
    var c21 = MatrixC();
    var c31 = MatrixC();
    var c02 = MatrixC();
    var c12 = MatrixC();
    var c22 = MatrixC();
    var c32 = MatrixC();
    let q = 3u * wid.z * QUADS;
    let add0 = biases(4u * (q + lane % QUADS));
    let add1 = biases(4u * (q + QUADS + lane % QUADS));
    let add2 = biases(4u * (q + 2u * QUADS + lane % QUADS));
    let chunks = (params.quads_a + params.quads_b) / QUADS;
    for (var n = 0u; n < chunks; n++) {
        workgroupBarrier();
        load_tile(local, origin, n);
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
            var k = column * 3u * MATRIX;
            let u0 = coopLoad<MatrixB>(&kernel[k], OUTPUT);
            let u1 = coopLoad<MatrixB>(&kernel[k + MATRIX], OUTPUT);
            let u2 = coopLoad<MatrixB>(&kernel[k + 2u * MATRIX], OUTPUT);
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
            k += 9u * MATRIX;
            let v0 = coopLoad<MatrixB>(&kernel[k], OUTPUT);
            let v1 = coopLoad<MatrixB>(&kernel[k + MATRIX], OUTPUT);
            let v2 = coopLoad<MatrixB>(&kernel[k + 2u * MATRIX], OUTPUT);
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
            k += 9u * MATRIX;
            let w0 = coopLoad<MatrixB>(&kernel[k], OUTPUT);
            let w1 = coopLoad<MatrixB>(&kernel[k + MATRIX], OUTPUT);
            let w2 = coopLoad<MatrixB>(&kernel[k + 2u * MATRIX], OUTPUT);
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
    // Named places: an index that is made inside the call has no value yet there.
    let sums0 = subgroup * SIDE * SUMS;
    let sums1 = sums0 + QUADS;
    let sums2 = sums1 + QUADS;
    let last = params.size.x * params.size.y * params.quads_out - 1u;
    let own_p = lane / QUADS;
    let own_q = lane % QUADS;
    #repeat r 4
    {
        let t0 = goal(x + own_p, y + $ru, q + own_q);
        let t1 = goal(x + own_p + OUT_PIXELS, y + $ru, q + own_q);
        let t2 = goal(x + own_p, y + $ru, q + QUADS + own_q);
        let t3 = goal(x + own_p + OUT_PIXELS, y + $ru, q + QUADS + own_q);
        let t4 = goal(x + own_p, y + $ru, q + 2u * QUADS + own_q);
        let t5 = goal(x + own_p + OUT_PIXELS, y + $ru, q + 2u * QUADS + own_q);
        // What the sums are added to, or masked by.
        var o0 = vec4<f16>();
        var o1 = vec4<f16>();
        var o2 = vec4<f16>();
        var o3 = vec4<f16>();
        var o4 = vec4<f16>();
        var o5 = vec4<f16>();
        if params.store >= ADD {
            o0 = output[min(t0, last)];
            o1 = output[min(t1, last)];
            o2 = output[min(t2, last)];
            o3 = output[min(t3, last)];
            o4 = output[min(t4, last)];
            o5 = output[min(t5, last)];
        }
        coopStoreT(c$r0, &sums[sums0], SUMS);
        coopStoreT(c$r1, &sums[sums1], SUMS);
        coopStoreT(c$r2, &sums[sums2], SUMS);
        workgroupBarrier();
        if t0 != NOWHERE {
            output[t0] = finish(sums[sums0 + own_p * SUMS + own_q] + add0, o0);
        }
        if t1 != NOWHERE {
            output[t1] = finish(sums[sums0 + (own_p + OUT_PIXELS) * SUMS + own_q] + add0, o1);
        }
        if t2 != NOWHERE {
            output[t2] = finish(sums[sums0 + own_p * SUMS + QUADS + own_q] + add1, o2);
        }
        if t3 != NOWHERE {
            output[t3] = finish(sums[sums0 + (own_p + OUT_PIXELS) * SUMS + QUADS + own_q] + add1, o3);
        }
        if t4 != NOWHERE {
            output[t4] = finish(sums[sums0 + own_p * SUMS + 2u * QUADS + own_q] + add2, o4);
        }
        if t5 != NOWHERE {
            output[t5] = finish(sums[sums0 + (own_p + OUT_PIXELS) * SUMS + 2u * QUADS + own_q] + add2, o5);
        }
        workgroupBarrier();
    }
    #end
}
