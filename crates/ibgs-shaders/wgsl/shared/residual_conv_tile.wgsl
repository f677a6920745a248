// What a workgroup of residual_conv holds: a tile of a few input channels with its halo, and their weights. All of a
// thread's reads are made before its first write, in any case and without a branch between them, so that they are under
// way together.
#import residual_map
#import residual_source

const COLUMNS: u32 = CONV_COLUMNS + 2u;
const ROWS: u32 = CONV_ROWS + 2u;
// (input channel, row group) pairs in workgroup memory: 4 x 2 or 2 x 4.
const PAIRS: u32 = 8u;

// The first two rows of each pair, which are also the last two of the group above it; one pair more for the last group of each
// channel. `upper_of` says where they lie.
var<workgroup> upper: array<array<array<f32, COLUMNS>, PAIRS + 4u>, 2>;
// The other rows of each pair.
var<workgroup> lower: array<array<array<f32, COLUMNS>, PAIRS>, CONV_ROWS - 2u>;
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

fn upper_of(pair: u32, row_groups: u32) -> u32 {
    return pair + pair / row_groups;
}

// Four numbers of an input by their positions: those of a channel lie CHANNELS apart.
fn four_a(i: vec4<u32>) -> vec4<f32> {
    let at = i / CHANNELS;
    return vec4(
        number(input_a[at.x], i.x),
        number(input_a[at.y], i.y),
        number(input_a[at.z], i.z),
        number(input_a[at.w], i.w),
    );
}

fn four_b(i: vec4<u32>) -> vec4<f32> {
    let at = i / CHANNELS;
    return vec4(
        number(input_b[at.x], i.x),
        number(input_b[at.y], i.y),
        number(input_b[at.z], i.z),
        number(input_b[at.w], i.w),
    );
}

fn four_pooled(i: vec4<u32>) -> vec4<f32> {
    let below = i + CHANNELS * params.source.x;
    return max(max(four_a(i), four_a(i + CHANNELS)), max(four_a(below), four_a(below + CHANNELS)));
}

// Positions of four values of a pair in the input, or -1.
fn places(chunk: Chunk, pair: u32, y: vec4<i32>, x: vec4<i32>) -> vec4<i32> {
    let channel = pair / chunk.row_groups;
    let c = chunk.first + channel;
    let first = i32((c / CHANNELS) * params.source.x * params.source.y);
    let inside = (y >= vec4(0)) & (x >= vec4(0)) & vec4(channel < chunk.channels);
    return select(vec4(-1), i32(CHANNELS) * (first + y + x) + i32(c % CHANNELS), inside);
}

// Whether the last two rows of a pair are no other's.
fn is_last(pair: u32, row_groups: u32) -> bool {
    return pair % row_groups == row_groups - 1u;
}

// The two columns at the right of a pair's row.
fn put_edge(pair: u32, row: u32, row_groups: u32, values: vec2<f32>) {
    if row >= 2u && row < CONV_ROWS {
        lower[row - 2u][pair][CONV_COLUMNS] = values.x;
        lower[row - 2u][pair][CONV_COLUMNS + 1u] = values.y;
    } else if row < 2u || is_last(pair, row_groups) {
        let place = upper_of(pair, row_groups) + row / CONV_ROWS;
        upper[row % CONV_ROWS][place][CONV_COLUMNS] = values.x;
        upper[row % CONV_ROWS][place][CONV_COLUMNS + 1u] = values.y;
    }
}

fn load_tile(local: u32, chunk: Chunk) {
    // A group of 32 threads takes two pairs of a channel; the two columns at the right go to other threads, a row each.
    let pair = 2u * (local / CONV_COLUMNS);
    let column = local % CONV_COLUMNS;
    let x = vec4(source_column[column]);
    let g = pair % chunk.row_groups;
    let h = (pair + 1u) % chunk.row_groups;
    let q0 = places(chunk, pair, vec4(source_row[g][0], source_row[g][1], source_row[g][2], source_row[g][3]), x);
    let q1 = places(chunk, pair, vec4(source_row[g][4], source_row[g][5], source_row[g][6], source_row[g][7]), x);
    let q2 = places(chunk, pair + 1u, vec4(source_row[h][0], source_row[h][1], source_row[h][2], source_row[h][3]), x);
    let q3 = places(chunk, pair + 1u, vec4(source_row[h][4], source_row[h][5], source_row[h][6], source_row[h][7]), x);
    let q4 = places(chunk, pair + 1u, vec4(source_row[h][8], source_row[h][9], -1, -1), x);
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
    let first = upper_of(pair, chunk.row_groups);
    upper[0][first][column] = t0.x;
    upper[1][first][column] = t0.y;
    lower[0][pair][column] = t0.z;
    lower[1][pair][column] = t0.w;
    lower[2][pair][column] = t1.x;
    lower[3][pair][column] = t1.y;
    lower[4][pair][column] = t1.z;
    lower[5][pair][column] = t1.w;
    upper[0][first + 1u][column] = t2.x;
    upper[1][first + 1u][column] = t2.y;
    lower[0][pair + 1u][column] = t2.z;
    lower[1][pair + 1u][column] = t2.w;
    lower[2][pair + 1u][column] = t3.x;
    lower[3][pair + 1u][column] = t3.y;
    lower[4][pair + 1u][column] = t3.z;
    lower[5][pair + 1u][column] = t3.w;
    if is_last(pair + 1u, chunk.row_groups) {
        upper[0][first + 2u][column] = t4.x;
        upper[1][first + 2u][column] = t4.y;
    }
    if local < PAIRS * ROWS {
        put_edge(row / ROWS, row % ROWS, chunk.row_groups, t5.xy);
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
