// A 3 x 3 convolution with zero padding on the matrix units, over one or two inputs (two: a concatenation that is never
// stored), or with weights packed for it the gradient by the input; channels last in half precision, sums in float32
// (method.md section 6).
//
// A workgroup of four subgroups makes SIDE columns x 16 rows x 3 SIDE outputs; a subgroup four rows: twelve accumulators, a
// row's pixels by SIDE outputs each. The tile passes through workgroup memory SIDE input channels at a time. A subgroup's six
// rows of the tile serve all three rows of taps. Weights are read as whole matrices, [input channels / SIDE][tap]
// [outputs / SIDE][output][input].
#import half
#import half_conv_tile

struct HalfConvParams {
    // Size of the output, and of what input a is read from.
    size: vec2<u32>,
    source: vec2<u32>,
    mode: u32,
    // Values a pixel, with padding: of input a and of input b (0: there is none) divided by 8, of the output divided by 4.
    pairs_a: u32,
    pairs_b: u32,
    quads_out: u32,
    outputs: u32,
    // First bias.
    bias: u32,
    // Where the packed weights begin, in groups of 8, and groups of SIDE outputs.
    packed: u32,
    packed_groups: u32,
    // What becomes of the sums.
    store: u32,
    pad: u32,
}

var<immediate> params: HalfConvParams;

@group(0) @binding(0) var<storage, read> weights: array<f32>;
@group(0) @binding(1) var<storage, read> packed: array<Pair>;
@group(0) @binding(2) var<storage, read> input_a: array<Pair>;
@group(0) @binding(3) var<storage, read> input_b: array<Pair>;
@group(0) @binding(4) var<storage, read_write> output: array<vec4<f16>>;

const THREADS: u32 = HALF_SUBGROUPS * LANES;
const ROWS: u32 = HALF_CONV_ROWS + 2u;
const COLUMNS: u32 = SIDE + 2u;
// Groups of 4 channels, and of 8, that pass at a time, and distances in workgroup memory; the padding avoids bank conflicts.
const QUADS: u32 = SIDE / 4u;
const PAIRS: u32 = SIDE / 8u;
const PIXEL: u32 = QUADS + 2u;
const LINE: u32 = COLUMNS * PIXEL;
const OUTPUT: u32 = QUADS + 1u;
const MATRIX: u32 = SIDE * OUTPUT;
const SUMS: u32 = 3u * QUADS + 1u;
// Pixels that the workgroup loads, or a subgroup stores, in one step.
const PIXELS: u32 = THREADS / PAIRS;
const OUT_PIXELS: u32 = LANES / QUADS;
const NOWHERE: u32 = 0xffffffffu;
// A lane stores two pixels of a row.
const_assert 2u * OUT_PIXELS >= SIDE;

// [row][column][channels].
var<workgroup> tile: array<vec4<f16>, ROWS * LINE>;
// [tap][outputs / SIDE][output][inputs].
var<workgroup> kernel: array<vec4<f16>, 27u * MATRIX>;
// Three matrices of sums of each subgroup: [subgroup][pixel][outputs].
var<workgroup> sums: array<vec4<f32>, HALF_SUBGROUPS * SIDE * SUMS>;

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
    #repeat g 3
    var c0$g = MatrixC();
    var c1$g = MatrixC();
    var c2$g = MatrixC();
    var c3$g = MatrixC();
    #end
    let q = 3u * wid.z * QUADS;
    #repeat g 3
    let add$g = biases(4u * (q + $gu * QUADS + lane % QUADS));
    #end
    let chunks = (params.pairs_a + params.pairs_b) / PAIRS;
    for (var n = 0u; n < chunks; n++) {
        workgroupBarrier();
        load_tile(local, origin, n);
        load_kernel(local, n, wid.z);
        workgroupBarrier();
        for (var column = 0u; column < 3u; column++) {
            let at = 4u * subgroup * LINE + column * PIXEL;
            #repeat r 6
            let a$r = coopLoadT<MatrixA>(&tile[at + $ru * LINE], PIXEL);
            #end
            var k = column * 3u * MATRIX;
            #repeat g 3
            let u$g = coopLoad<MatrixB>(&kernel[k + $gu * MATRIX], OUTPUT);
            #end
            #repeat g 3
            c0$g = coopMultiplyAdd(a0, u$g, c0$g);
            c1$g = coopMultiplyAdd(a1, u$g, c1$g);
            c2$g = coopMultiplyAdd(a2, u$g, c2$g);
            c3$g = coopMultiplyAdd(a3, u$g, c3$g);
            #end
            k += 9u * MATRIX;
            #repeat g 3
            let v$g = coopLoad<MatrixB>(&kernel[k + $gu * MATRIX], OUTPUT);
            #end
            #repeat g 3
            c0$g = coopMultiplyAdd(a1, v$g, c0$g);
            c1$g = coopMultiplyAdd(a2, v$g, c1$g);
            c2$g = coopMultiplyAdd(a3, v$g, c2$g);
            c3$g = coopMultiplyAdd(a4, v$g, c3$g);
            #end
            k += 9u * MATRIX;
            #repeat g 3
            let w$g = coopLoad<MatrixB>(&kernel[k + $gu * MATRIX], OUTPUT);
            #end
            #repeat g 3
            c0$g = coopMultiplyAdd(a2, w$g, c0$g);
            c1$g = coopMultiplyAdd(a3, w$g, c1$g);
            c2$g = coopMultiplyAdd(a4, w$g, c2$g);
            c3$g = coopMultiplyAdd(a5, w$g, c3$g);
            #end
        }
    }
    let x = u32(origin.x);
    let y = u32(origin.y) + 4u * subgroup;
    // The indices need names: an index that is computed inside the call has no value yet there.
    #repeat g 3
    let sums$g = subgroup * SIDE * SUMS + $gu * QUADS;
    #end
    let last = params.size.x * params.size.y * params.quads_out - 1u;
    let own_q = lane % QUADS;
    let left = lane / QUADS;
    let right = left + OUT_PIXELS;
    // A subgroup reads no other's sums.
    #repeat r 4
    {
        // Output positions of the lane's two pixels, and the values that the sums are added to or masked by.
        #repeat g 3
        let goal_left$g = goal(x + left, y + $ru, q + $gu * QUADS + own_q);
        let goal_right$g = goal(x + right, y + $ru, q + $gu * QUADS + own_q);
        var old_left$g = vec4<f16>();
        var old_right$g = vec4<f16>();
        #end
        if params.store >= STORE_ADD {
            #repeat g 3
            old_left$g = output[min(goal_left$g, last)];
            old_right$g = output[min(goal_right$g, last)];
            #end
        }
        #repeat g 3
        coopStoreT(c$r$g, &sums[sums$g], SUMS);
        #end
        subgroupBarrier();
        #repeat g 3
        if goal_left$g != NOWHERE {
            output[goal_left$g] = finish(sums[sums$g + left * SUMS + own_q] + add$g, old_left$g);
        }
        if goal_right$g != NOWHERE {
            output[goal_right$g] = finish(sums[sums$g + right * SUMS + own_q] + add$g, old_right$g);
        }
        #end
        subgroupBarrier();
    }
    #end
}
