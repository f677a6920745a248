// What a workgroup of residual_conv holds: a tile of a few input channels with its halo, and their weights. All of a
// thread's reads are made before its first write, in any case and without a branch between them, so that they are under
// way together.
#import residual_source

const COLUMNS: u32 = CONV_COLUMNS + 2u;
const ROWS: u32 = CONV_ROWS + 2u;
// (input channel, row group) pairs in workgroup memory: 4 x 2 or 2 x 4.
const PAIRS: u32 = 8u;

var<workgroup> tile: array<array<array<f32, COLUMNS>, ROWS>, PAIRS>;
// [input channel, tap column, output group][tap row * 5 + output quad].
var<workgroup> kernel: array<array<vec4<f32>, 15>, 24>;
// Source row (times its width) and column of each of the tile's rows and columns; -1 outside.
var<workgroup> source_row: array<array<i32, ROWS>, 4>;
var<workgroup> source_column: array<i32, COLUMNS>;

// The channels of one input that pass through workgroup memory together.
struct Chunk {
    // Of input b instead of a.
    second: bool,
    // First channel of that input, and how many.
    first: u32,
    channels: u32,
    row_groups: u32,
}

fn four_a(i: vec4<u32>) -> vec4<f32> {
    return vec4(input_a[i.x], input_a[i.y], input_a[i.z], input_a[i.w]);
}

fn four_b(i: vec4<u32>) -> vec4<f32> {
    return vec4(input_b[i.x], input_b[i.y], input_b[i.z], input_b[i.w]);
}

fn four_pooled(i: vec4<u32>) -> vec4<f32> {
    let below = i + params.source.x;
    return max(max(four_a(i), four_a(i + 1u)), max(four_a(below), four_a(below + 1u)));
}

// Positions of four values of a pair in the input, or -1.
fn places(chunk: Chunk, pair: u32, y: vec4<i32>, x: vec4<i32>) -> vec4<i32> {
    let channel = pair / chunk.row_groups;
    let first = i32((chunk.first + channel) * params.source.x * params.source.y);
    let inside = (y >= vec4(0)) & (x >= vec4(0)) & vec4(channel < chunk.channels);
    return select(vec4(-1), first + y + x, inside);
}

fn load_tile(local: u32, chunk: Chunk) {
    // A group of 32 threads takes two pairs; the two columns at the right go to other threads, a row each.
    let pair = 2u * (local / CONV_COLUMNS);
    let column = local % CONV_COLUMNS;
    let x = vec4(source_column[column]);
    let g = pair % chunk.row_groups;
    let h = (pair + 1u) % chunk.row_groups;
    let q0 = places(chunk, pair, vec4(source_row[g][0], source_row[g][1], source_row[g][2], source_row[g][3]), x);
    let q1 = places(chunk, pair, vec4(source_row[g][4], source_row[g][5], source_row[g][6], source_row[g][7]), x);
    let q2 = places(chunk, pair + 1u, vec4(source_row[h][0], source_row[h][1], source_row[h][2], source_row[h][3]), x);
    let q3 = places(chunk, pair + 1u, vec4(source_row[h][4], source_row[h][5], source_row[h][6], source_row[h][7]), x);
    let g8 = vec4(source_row[g][8], source_row[g][9], -1, -1);
    let h8 = vec4(-1, -1, source_row[h][8], source_row[h][9]);
    let q4 = max(places(chunk, pair, g8, x), places(chunk, pair + 1u, h8, x));
    let row = min(local, PAIRS * ROWS - 1u);
    let edge = vec4(source_column[32], source_column[33], -1, -1);
    let q5 = places(chunk, row / ROWS, vec4(source_row[(row / ROWS) % chunk.row_groups][row % ROWS]), edge);
    let zero = vec4(0);
    let i0 = vec4<u32>(max(q0, zero));
    let i1 = vec4<u32>(max(q1, zero));
    let i2 = vec4<u32>(max(q2, zero));
    let i3 = vec4<u32>(max(q3, zero));
    let i4 = vec4<u32>(max(q4, zero));
    let i5 = vec4<u32>(max(q5, zero));
    var t0: vec4<f32>;
    var t1: vec4<f32>;
    var t2: vec4<f32>;
    var t3: vec4<f32>;
    var t4: vec4<f32>;
    var t5: vec4<f32>;
    if chunk.second {
        t0 = four_b(i0);
        t1 = four_b(i1);
        t2 = four_b(i2);
        t3 = four_b(i3);
        t4 = four_b(i4);
        t5 = four_b(i5);
    } else if params.mode == CONV_POOLED {
        t0 = four_pooled(i0);
        t1 = four_pooled(i1);
        t2 = four_pooled(i2);
        t3 = four_pooled(i3);
        t4 = four_pooled(i4);
        t5 = four_pooled(i5);
    } else {
        t0 = four_a(i0);
        t1 = four_a(i1);
        t2 = four_a(i2);
        t3 = four_a(i3);
        t4 = four_a(i4);
        t5 = four_a(i5);
    }
    t0 = select(vec4(0.0), t0, q0 >= zero);
    t1 = select(vec4(0.0), t1, q1 >= zero);
    t2 = select(vec4(0.0), t2, q2 >= zero);
    t3 = select(vec4(0.0), t3, q3 >= zero);
    t4 = select(vec4(0.0), t4, q4 >= zero);
    t5 = select(vec4(0.0), t5, q5 >= zero);
    tile[pair][0][column] = t0.x;
    tile[pair][1][column] = t0.y;
    tile[pair][2][column] = t0.z;
    tile[pair][3][column] = t0.w;
    tile[pair][4][column] = t1.x;
    tile[pair][5][column] = t1.y;
    tile[pair][6][column] = t1.z;
    tile[pair][7][column] = t1.w;
    tile[pair][8][column] = t4.x;
    tile[pair][9][column] = t4.y;
    tile[pair + 1u][0][column] = t2.x;
    tile[pair + 1u][1][column] = t2.y;
    tile[pair + 1u][2][column] = t2.z;
    tile[pair + 1u][3][column] = t2.w;
    tile[pair + 1u][4][column] = t3.x;
    tile[pair + 1u][5][column] = t3.y;
    tile[pair + 1u][6][column] = t3.z;
    tile[pair + 1u][7][column] = t3.w;
    tile[pair + 1u][8][column] = t4.z;
    tile[pair + 1u][9][column] = t4.w;
    if local < PAIRS * ROWS {
        tile[row / ROWS][row % ROWS][32] = t5.x;
        tile[row / ROWS][row % ROWS][33] = t5.y;
    }
}

fn weight(inside: bool, channel: u32, o: u32, tap: u32) -> f32 {
    let i = params.weights + o * params.stride_out + channel * params.stride_in + tap;
    let wanted = inside && o < params.outputs;
    return select(0.0, weights[select(0u, i, wanted)], wanted);
}

// Four outputs' weights for kernel[k / 15][k % 15].
fn weight_quad(chunk: Chunk, k: u32) -> vec4<f32> {
    let column = (k / 15u) / params.groups;
    let channel = column / 3u;
    let inside = channel < chunk.channels;
    let o = ((k / 15u) % params.groups) * CONV_OUTPUTS + 4u * (k % 5u);
    var tap = 3u * ((k % 15u) / 5u) + column % 3u;
    tap = select(tap, 8u - tap, params.turned == 1u);
    let c = chunk.first + channel + select(0u, params.channels_a, chunk.second);
    return vec4(
        weight(inside, c, o, tap),
        weight(inside, c, o + 1u, tap),
        weight(inside, c, o + 2u, tap),
        weight(inside, c, o + 3u, tap),
    );
}

fn load_kernel(local: u32, chunk: Chunk) {
    let w0 = weight_quad(chunk, local);
    let w1 = weight_quad(chunk, local + 128u);
    let w2 = weight_quad(chunk, local + 256u);
    kernel[local / 15u][local % 15u] = w0;
    kernel[(local + 128u) / 15u][(local + 128u) % 15u] = w1;
    if local < 104u {
        kernel[(local + 256u) / 15u][(local + 256u) % 15u] = w2;
    }
}
