// Gradient of a convolution's weights and biases on the matrix units: dW[tap][i][o] = sum over pixels of x[p + tap][i] v[p][o].
//
// A workgroup of nine subgroups, one a tap, walks through a part of the tiles of SIDE x 4 pixels for 3 SIDE inputs (y of the
// workgroup) and 3 SIDE outputs (z): nine accumulators a subgroup, whose sums over a row's SIDE pixels are one product. The
// first channel of the input's padding counts as 1, which makes the biases' gradient one more row of the middle tap. A 1 x 1
// convolution uses the middle tap alone.
#import half
#import residual_source

struct HalfConvWeightsParams {
    // Size of v and of the convolution's input, and of what the input is read from.
    size: vec2<u32>,
    source: vec2<u32>,
    mode: u32,
    // Channels of the input; values a pixel with padding, divided by 8, of input and v.
    inputs: u32,
    pairs_in: u32,
    pairs_out: u32,
    // Workgroups that share the tiles.
    splits: u32,
    pad: u32,
}

var<immediate> params: HalfConvWeightsParams;

@group(0) @binding(0) var<storage, read> v: array<Pair>;
@group(0) @binding(1) var<storage, read> input: array<Pair>;
// [split][group of inputs][group of outputs][tap][input][output].
@group(0) @binding(2) var<storage, read_write> partials: array<f32>;

const THREADS: u32 = 9u * LANES;
const ROWS: u32 = HALF_WEIGHTS_ROWS;
const COLUMNS: u32 = SIDE + 2u;
const QUADS: u32 = SIDE / 4u;
const GROUP: u32 = 3u * QUADS;
// The padding avoids bank conflicts.
const PIXEL: u32 = GROUP + 2u;
// Pairs of a pixel and of the tiles.
const PAIRS: u32 = GROUP / 2u;
const X_PAIRS: u32 = (ROWS + 2u) * COLUMNS * PAIRS;
const V_PAIRS: u32 = ROWS * SIDE * PAIRS;
// The repetitions below are enough.
const_assert 3u * THREADS >= X_PAIRS;
const_assert 2u * THREADS >= V_PAIRS;

var<workgroup> x_tile: array<vec4<f16>, (ROWS + 2u) * COLUMNS * PIXEL>;
var<workgroup> v_tile: array<vec4<f16>, ROWS * SIDE * PIXEL>;

// Where the input of (x, y) lies.
fn input_at(x: i32, y: i32) -> u32 {
    if params.mode == CONV_NEAREST {
        let at = vec2<u32>(vec2(x, y)) * params.source / params.size;
        return (at.y * params.source.x + at.x) * params.pairs_in;
    }
    let step = select(1u, 2u, params.mode == CONV_POOLED);
    return (u32(y) * params.source.x + u32(x)) * params.pairs_in * step;
}

// The first channel of the padding counts as 1.
fn with_one(value: vec4<f16>, channel: u32) -> vec4<f16> {
    return select(value, vec4(1.0h), vec4(channel, channel + 1u, channel + 2u, channel + 3u) == vec4(params.inputs));
}

fn read_pooled(at: u32) -> Pair {
    let below = at + params.source.x * params.pairs_in;
    let upper = larger(input[at], input[at + params.pairs_in]);
    return larger(upper, larger(input[below], input[below + params.pairs_in]));
}

fn put_input(k: u32, pair: u32, value: Pair, inside: bool) {
    if k < X_PAIRS {
        let at = (k / PAIRS) * PIXEL + 2u * (k % PAIRS);
        x_tile[at] = select(vec4<f16>(), with_one(value.a, 8u * pair), inside);
        x_tile[at + 1u] = select(vec4<f16>(), with_one(value.b, 8u * pair + 4u), inside);
    }
}

fn put_v(k: u32, value: Pair, inside: bool) {
    if k < V_PAIRS {
        let at = (k / PAIRS) * PIXEL + 2u * (k % PAIRS);
        v_tile[at] = select(vec4<f16>(), value.a, inside);
        v_tile[at + 1u] = select(vec4<f16>(), value.b, inside);
    }
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let tap = local / LANES;
    let tiles = (params.size + vec2(SIDE - 1u, ROWS - 1u)) / vec2(SIDE, ROWS);
    let count = tiles.x * tiles.y;
    let share = (count + params.splits - 1u) / params.splits;
    let end = min((wid.x + 1u) * share, count);
    var c00 = MatrixC();
    var c01 = MatrixC();
    var c02 = MatrixC();
    var c10 = MatrixC();
    var c11 = MatrixC();
    var c12 = MatrixC();
    var c20 = MatrixC();
    var c21 = MatrixC();
    var c22 = MatrixC();
    let first = wid.x * share;
    let first_in = wid.y * PAIRS;
    let first_out = wid.z * PAIRS;
    // Pixel of the tile and pair of each step; a pixel far out where there is none.
    let far = i32(0x4000000);
    #repeat n 3
    let kx$n = local + $nu * THREADS;
    let qx$n = first_in + kx$n % PAIRS;
    let px$n = vec2(select(far, i32((kx$n / PAIRS) % COLUMNS) - 1, qx$n < params.pairs_in), i32(kx$n / (PAIRS * COLUMNS)) - 1);
    var x$n = Pair();
    #end
    #repeat n 2
    let kv$n = local + $nu * THREADS;
    let qv$n = first_out + kv$n % PAIRS;
    let pv$n = vec2(select(far, i32((kv$n / PAIRS) % SIDE), qv$n < params.pairs_out), i32(kv$n / (PAIRS * SIDE)));
    var v$n = Pair();
    #end
    var inside = 0u;
    // One step ahead of the sums.
    for (var t = first; t < end + 1u; t++) {
        if t > first {
            workgroupBarrier();
            #repeat n 3
            put_input(kx$n, qx$n, x$n, (inside & (1u << $nu)) != 0u);
            #end
            #repeat n 2
            put_v(kv$n, v$n, (inside & (32u << $nu)) != 0u);
            #end
            workgroupBarrier();
        }
        if t < end {
            let corner = vec2<i32>(vec2(t % tiles.x, t / tiles.x) * vec2(SIDE, ROWS));
            let size = vec2<i32>(params.size);
            inside = 0u;
            #repeat n 3
            let c$n = corner + px$n;
            let in$n = c$n.x >= 0 && c$n.y >= 0 && c$n.x < size.x && c$n.y < size.y;
            let at$n = select(0u, input_at(c$n.x, c$n.y) + qx$n, in$n);
            inside |= select(0u, 1u << $nu, in$n);
            #end
            if params.mode == CONV_POOLED {
                #repeat n 3
                x$n = read_pooled(at$n);
                #end
            } else {
                #repeat n 3
                x$n = input[at$n];
                #end
            }
            #repeat n 2
            let d$n = corner + pv$n;
            let iv$n = d$n.x < size.x && d$n.y < size.y;
            v$n = v[select(0u, u32(d$n.y * size.x + d$n.x) * params.pairs_out + qv$n, iv$n)];
            inside |= select(0u, 32u << $nu, iv$n);
            #end
        }
        if t == first {
            continue;
        }
        for (var row = 0u; row < ROWS; row++) {
            let x = ((row + tap / 3u) * COLUMNS + tap % 3u) * PIXEL;
            let g = row * SIDE * PIXEL;
            // Rows are channels, columns pixels.
            let a0 = coopLoad<MatrixA>(&x_tile[x], PIXEL);
            let a1 = coopLoad<MatrixA>(&x_tile[x + QUADS], PIXEL);
            let a2 = coopLoad<MatrixA>(&x_tile[x + 2u * QUADS], PIXEL);
            let b0 = coopLoadT<MatrixB>(&v_tile[g], PIXEL);
            let b1 = coopLoadT<MatrixB>(&v_tile[g + QUADS], PIXEL);
            let b2 = coopLoadT<MatrixB>(&v_tile[g + 2u * QUADS], PIXEL);
            c00 = coopMultiplyAdd(a0, b0, c00);
            c01 = coopMultiplyAdd(a0, b1, c01);
            c02 = coopMultiplyAdd(a0, b2, c02);
            c10 = coopMultiplyAdd(a1, b0, c10);
            c11 = coopMultiplyAdd(a1, b1, c11);
            c12 = coopMultiplyAdd(a1, b2, c12);
            c20 = coopMultiplyAdd(a2, b0, c20);
            c21 = coopMultiplyAdd(a2, b1, c21);
            c22 = coopMultiplyAdd(a2, b2, c22);
        }
    }
    // The indices need names: an index that is computed inside the call has no value yet there.
    let line = 3u * SIDE;
    let block = ((wid.x * groups.y + wid.y) * groups.z + wid.z) * 9u + tap;
    let row0 = block * line * line;
    let row1 = row0 + SIDE * line;
    let row2 = row1 + SIDE * line;
    let at01 = row0 + SIDE;
    let at02 = at01 + SIDE;
    let at11 = row1 + SIDE;
    let at12 = at11 + SIDE;
    let at21 = row2 + SIDE;
    let at22 = at21 + SIDE;
    coopStoreT(c00, &partials[row0], line);
    coopStoreT(c01, &partials[at01], line);
    coopStoreT(c02, &partials[at02], line);
    coopStoreT(c10, &partials[row1], line);
    coopStoreT(c11, &partials[at11], line);
    coopStoreT(c12, &partials[at12], line);
    coopStoreT(c20, &partials[row2], line);
    coopStoreT(c21, &partials[at21], line);
    coopStoreT(c22, &partials[at22], line);
}
