// A thread owns 8 pixels of a column times 20 output channels: ten 4 x 4 registers (columns: pixels, rows: output
// channels). A workgroup of 32 columns is 2 groups of outputs x 16 rows, or 1 x 32. Tile and weights pass through
// workgroup memory a few input channels at a time; whatever lies outside is filled with zeros, so the inner loop has no
// branch, and all of its register indices are constants.
#import residual_conv_tile

// The outer product of four outputs' weights and four pixels, added.
fn add(m: mat4x4<f32>, w: vec4<f32>, x: vec4<f32>) -> mat4x4<f32> {
    return mat4x4(
        fma(w, vec4(x.x), m[0]),
        fma(w, vec4(x.y), m[1]),
        fma(w, vec4(x.z), m[2]),
        fma(w, vec4(x.w), m[3]),
    );
}

#if PACKED
fn relu(o: u32, sum: f32) -> f32 {
    return max(sum + weights[params.bias + min(o, params.outputs - 1u)], 0.0);
}

fn store(o: u32, x: u32, y: u32, sums: vec2<f32>) {
    if o < params.outputs && x < params.size.x && y < params.size.y {
        output[((o / CHANNELS) * params.size.y + y) * params.size.x + x] = word(relu(o, sums.x), relu(o + 1u, sums.y));
    }
}

fn store_pixel(o: u32, x: u32, y: u32, sums: vec4<f32>) {
    store(o, x, y, sums.xy);
    store(o + 2u, x, y, sums.zw);
}
#else
fn store(o: u32, x: u32, y: u32, sum: f32) {
    if o >= params.outputs || x >= params.size.x || y >= params.size.y {
        return;
    }
    let i = (o * params.size.y + y) * params.size.x + x;
    if params.store == STORE_RELU {
        output[i] = max(sum + weights[params.bias + o], 0.0);
    } else if params.store == STORE_ASSIGN {
        output[i] = sum;
    } else if params.store == STORE_ADD {
        output[i] += sum;
    } else {
        output[i] = select(0.0, sum, output[i] > 0.0);
    }
}

fn store_pixel(o: u32, x: u32, y: u32, sums: vec4<f32>) {
    store(o, x, y, sums.x);
    store(o + 1u, x, y, sums.y);
    store(o + 2u, x, y, sums.z);
    store(o + 3u, x, y, sums.w);
}
#endif

fn store_quad(o: u32, x: u32, y: u32, upper: mat4x4<f32>, lower: mat4x4<f32>) {
    store_pixel(o, x, y, upper[0]);
    store_pixel(o, x, y + 1u, upper[1]);
    store_pixel(o, x, y + 2u, upper[2]);
    store_pixel(o, x, y + 3u, upper[3]);
    store_pixel(o, x, y + 4u, lower[0]);
    store_pixel(o, x, y + 5u, lower[1]);
    store_pixel(o, x, y + 6u, lower[2]);
    store_pixel(o, x, y + 7u, lower[3]);
}

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let row_groups = 4u / params.groups;
    let channels = PAIRS / row_groups;
    let lane = local % CONV_COLUMNS;
    let row_group = (local / CONV_COLUMNS) % row_groups;
    let group = local / (CONV_COLUMNS * row_groups);
    let origin = vec2<i32>(wid.xy * vec2(CONV_COLUMNS, CONV_ROWS * row_groups));
    if local < 40u {
        let y = origin.y + i32(local / ROWS) * 8 + i32(local % ROWS) - 1;
        let row = source_of(y, params.size.y, params.source.y, params.mode);
        source_row[local / ROWS][local % ROWS] = select(row * i32(params.source.x), -1, row < 0);
    }
    if local < COLUMNS {
        source_column[local] = source_of(origin.x + i32(local) - 1, params.size.x, params.source.x, params.mode);
    }
    // Pixels 0..4 (a) and 4..8 (b) of five quads of outputs.
    var a0 = mat4x4<f32>();
    var a1 = mat4x4<f32>();
    var a2 = mat4x4<f32>();
    var a3 = mat4x4<f32>();
    var a4 = mat4x4<f32>();
    var b0 = mat4x4<f32>();
    var b1 = mat4x4<f32>();
    var b2 = mat4x4<f32>();
    var b3 = mat4x4<f32>();
    var b4 = mat4x4<f32>();
    let chunks_a = (params.channels_a + channels - 1u) / channels;
    let chunks = chunks_a + (params.channels_b + channels - 1u) / channels;
    for (var n = 0u; n < chunks; n++) {
        let second = n >= chunks_a;
        let first = channels * select(n, n - chunks_a, second);
        let left = select(params.channels_a, params.channels_b, second) - first;
        let chunk = Chunk(second, first, min(channels, left), row_groups);
        workgroupBarrier();
        load_tile(local, chunk);
        load_kernel(local, chunk);
        workgroupBarrier();
        for (var k = 0u; k < 3u * chunk.channels; k++) {
            let channel = k / 3u;
            let pair = channel * row_groups + row_group;
            // As `upper_of`.
            let first = pair + channel;
            let x = lane + k % 3u;
            let w = k * params.groups + group;
            let p0 = vec4(upper[0][first][x], upper[1][first][x], lower[0][pair][x], lower[1][pair][x]);
            let p4 = vec4(lower[2][pair][x], lower[3][pair][x], lower[4][pair][x], lower[5][pair][x]);
            let p8 = vec2(upper[0][first + 1u][x], upper[1][first + 1u][x]);
            a0 = add(a0, kernel[w][0], p0);
            b0 = add(b0, kernel[w][0], p4);
            a1 = add(a1, kernel[w][1], p0);
            b1 = add(b1, kernel[w][1], p4);
            a2 = add(a2, kernel[w][2], p0);
            b2 = add(b2, kernel[w][2], p4);
            a3 = add(a3, kernel[w][3], p0);
            b3 = add(b3, kernel[w][3], p4);
            a4 = add(a4, kernel[w][4], p0);
            b4 = add(b4, kernel[w][4], p4);
            let p1 = vec4(p0.yzw, p4.x);
            let p5 = vec4(p4.yzw, p8.x);
            a0 = add(a0, kernel[w][5], p1);
            b0 = add(b0, kernel[w][5], p5);
            a1 = add(a1, kernel[w][6], p1);
            b1 = add(b1, kernel[w][6], p5);
            a2 = add(a2, kernel[w][7], p1);
            b2 = add(b2, kernel[w][7], p5);
            a3 = add(a3, kernel[w][8], p1);
            b3 = add(b3, kernel[w][8], p5);
            a4 = add(a4, kernel[w][9], p1);
            b4 = add(b4, kernel[w][9], p5);
            let p2 = vec4(p0.zw, p4.xy);
            let p6 = vec4(p4.zw, p8);
            a0 = add(a0, kernel[w][10], p2);
            b0 = add(b0, kernel[w][10], p6);
            a1 = add(a1, kernel[w][11], p2);
            b1 = add(b1, kernel[w][11], p6);
            a2 = add(a2, kernel[w][12], p2);
            b2 = add(b2, kernel[w][12], p6);
            a3 = add(a3, kernel[w][13], p2);
            b3 = add(b3, kernel[w][13], p6);
            a4 = add(a4, kernel[w][14], p2);
            b4 = add(b4, kernel[w][14], p6);
        }
    }
    let x = u32(origin.x) + lane;
    let y = u32(origin.y) + CONV_ROWS * row_group;
    let o = CONV_OUTPUTS * group;
    store_quad(o, x, y, a0, b0);
    store_quad(o + 4u, x, y, a1, b1);
    store_quad(o + 8u, x, y, a2, b2);
    store_quad(o + 12u, x, y, a3, b3);
    store_quad(o + 16u, x, y, a4, b4);
}
