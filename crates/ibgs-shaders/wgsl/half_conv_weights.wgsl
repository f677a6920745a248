// Gradient of a convolution's weights and biases on the matrix units: dW[tap][i][o] = sum over pixels of x[p + tap][i] v[p][o].
//
// A workgroup of nine subgroups, one a tap, walks through a part of the tiles of SIDE x 4 pixels for 3 SIDE inputs (y of the
// workgroup) and 3 SIDE outputs (z): nine accumulators a subgroup, whose sums over a row's SIDE pixels are one product. The
// first channel of the input's padding counts as 1, which makes the biases' gradient one more row of the middle tap. A 1 x 1
// convolution uses the middle tap alone.
#import residual_source

struct HalfConvWeightsParams {
    // Size of v and of the convolution's input, and of what the input is read from.
    size: vec2<u32>,
    source: vec2<u32>,
    mode: u32,
    // Channels of the input; values a pixel with padding, divided by 4, of input and v.
    inputs: u32,
    quads_in: u32,
    quads_out: u32,
    // Workgroups that share the tiles.
    splits: u32,
    pad: u32,
}

var<immediate> params: HalfConvWeightsParams;

@group(0) @binding(0) var<storage, read> v: array<vec4<f16>>;
@group(0) @binding(1) var<storage, read> input: array<vec4<f16>>;
// [split][group of inputs][group of outputs][tap][input][output].
@group(0) @binding(2) var<storage, read_write> partials: array<f32>;

const THREADS: u32 = 9u * LANES;
const ROWS: u32 = 4u;
const COLUMNS: u32 = SIDE + 2u;
const QUADS: u32 = SIDE / 4u;
const GROUP: u32 = 3u * QUADS;
// The padding avoids bank conflicts.
const PIXEL: u32 = GROUP + 2u;

var<workgroup> x_tile: array<vec4<f16>, (ROWS + 2u) * COLUMNS * PIXEL>;
var<workgroup> v_tile: array<vec4<f16>, ROWS * SIDE * PIXEL>;

fn read_input(at: u32) -> vec4<f16> {
    if params.mode == POOLED {
        let right = params.quads_in;
        let below = params.source.x * params.quads_in;
        return max(max(input[at], input[at + right]), max(input[at + below], input[at + below + right]));
    }
    return input[at];
}

fn load(local: u32, corner: vec2<i32>, first_in: u32, first_out: u32) {
    for (var k = local; k < (ROWS + 2u) * COLUMNS * GROUP; k += THREADS) {
        let q = first_in + k % GROUP;
        let column = (k / GROUP) % COLUMNS;
        let row = k / (GROUP * COLUMNS);
        let x = source_of(corner.x + i32(column) - 1, params.size.x, params.source.x, params.mode);
        let y = source_of(corner.y + i32(row) - 1, params.size.y, params.source.y, params.mode);
        var value = vec4<f16>();
        if x >= 0 && y >= 0 && q < params.quads_in {
            value = read_input((u32(y) * params.source.x + u32(x)) * params.quads_in + q);
            if q == params.inputs / 4u {
                value[params.inputs % 4u] = f16(1.0);
            }
        }
        x_tile[(row * COLUMNS + column) * PIXEL + k % GROUP] = value;
    }
    for (var k = local; k < ROWS * SIDE * GROUP; k += THREADS) {
        let q = first_out + k % GROUP;
        let x = u32(corner.x) + (k / GROUP) % SIDE;
        let y = u32(corner.y) + k / (GROUP * SIDE);
        var value = vec4<f16>();
        if x < params.size.x && y < params.size.y && q < params.quads_out {
            value = v[(y * params.size.x + x) * params.quads_out + q];
        }
        v_tile[(k / GROUP) * PIXEL + k % GROUP] = value;
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
    for (var t = wid.x * share; t < end; t++) {
        workgroupBarrier();
        load(local, vec2<i32>(vec2(t % tiles.x, t / tiles.x) * vec2(SIDE, ROWS)), wid.y * GROUP, wid.z * GROUP);
        workgroupBarrier();
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
    // Named places: an index that is made inside the call has no value yet there.
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
