// Gradient of a 3 x 3 convolution's weights and biases: dW[o][i][tap] = sum over pixels of v[o][p] x[i][p + tap].
//
// Each workgroup walks through a part of the 16 x 2 pixel tiles and writes one row of partial sums. A thread owns
// 4 outputs x 2 inputs x 9 taps (18 registers of four outputs) and slides along the tile's rows four pixels at a time.
#import residual_source

struct ConvWeightsParams {
    // Size of v and of the convolution's input.
    size: vec2<u32>,
    // Size of what the input is read from.
    source: vec2<u32>,
    mode: u32,
    // Channels of the input and of v, at most 38.
    inputs: u32,
    outputs: u32,
    // Workgroups that share the tiles.
    splits: u32,
}

var<immediate> params: ConvWeightsParams;

@group(0) @binding(0) var<storage, read> v: array<f32>;
@group(0) @binding(1) var<storage, read> input: array<f32>;
// [split][outputs * inputs * 9 weights, then outputs biases].
@group(0) @binding(2) var<storage, read_write> partials: array<f32>;

const CHANNELS: u32 = 38u;
// Per channel 4 rows of 5 x 4 columns; one more against bank conflicts, as in v_tile.
var<workgroup> x_tile: array<array<vec4<f32>, 21>, CHANNELS>;
// [pixel][output quad].
var<workgroup> v_tile: array<array<vec4<f32>, 11>, 32>;

// Where a thread's values of the input tile lie in the source and go in the tile.
struct Place {
    inside: bool,
    first: u32,
    into: u32,
}

fn wanted(place: Place, c: u32) -> vec4<bool> {
    return vec4(place.inside) & (c + vec4(0u, 2u, 4u, 6u) < vec4(params.inputs));
}

// Four values, of every other channel from c on. Reads in any case, so that many reads can be under way at once.
fn four(place: Place, c: u32, shift: u32) -> vec4<f32> {
    let plane = params.source.x * params.source.y;
    let position = (c + vec4(0u, 2u, 4u, 6u)) * plane + place.first;
    let i = select(vec4(0u), position, wanted(place, c)) + shift;
    return vec4(input[i.x], input[i.y], input[i.z], input[i.w]);
}

fn four_pooled(place: Place, c: u32) -> vec4<f32> {
    let below = params.source.x;
    let upper = max(four(place, c, 0u), four(place, c, 1u));
    return max(upper, max(four(place, c, below), four(place, c, below + 1u)));
}

fn put(place: Place, c: u32, values: vec4<f32>) {
    let v = select(vec4(0.0), values, wanted(place, c));
    x_tile[c][place.into / 4u][place.into % 4u] = v.x;
    x_tile[c + 2u][place.into / 4u][place.into % 4u] = v.y;
    x_tile[c + 4u][place.into / 4u][place.into % 4u] = v.z;
    if c + 6u < CHANNELS {
        x_tile[c + 6u][place.into / 4u][place.into % 4u] = v.w;
    }
}

fn load_inputs(local: u32, corner: vec2<i32>) {
    let into = local % 80u;
    let column = into % 20u;
    let x = source_of(corner.x + i32(column) - 1, params.size.x, params.source.x, params.mode);
    let y = source_of(corner.y + i32(into / 20u) - 1, params.size.y, params.source.y, params.mode);
    let inside = x >= 0 && y >= 0 && column < 18u;
    let place = Place(inside, u32(y) * params.source.x + u32(x), into);
    let c = local / 80u;
    var t0: vec4<f32>;
    var t1: vec4<f32>;
    var t2: vec4<f32>;
    var t3: vec4<f32>;
    var t4: vec4<f32>;
    if params.mode == POOLED {
        t0 = four_pooled(place, c);
        t1 = four_pooled(place, c + 8u);
        t2 = four_pooled(place, c + 16u);
        t3 = four_pooled(place, c + 24u);
        t4 = four_pooled(place, c + 32u);
    } else {
        t0 = four(place, c, 0u);
        t1 = four(place, c + 8u, 0u);
        t2 = four(place, c + 16u, 0u);
        t3 = four(place, c + 24u, 0u);
        t4 = four(place, c + 32u, 0u);
    }
    put(place, c, t0);
    put(place, c + 8u, t1);
    put(place, c + 16u, t2);
    put(place, c + 24u, t3);
    put(place, c + 32u, t4);
}

// Reads in any case, so that many reads can be under way at once.
fn gradient(inside: bool, o: u32, at: u32) -> f32 {
    let wanted = inside && o < params.outputs;
    return select(0.0, v[select(0u, o * params.size.x * params.size.y + at, wanted)], wanted);
}

// Four outputs of one pixel.
fn gradients(o: u32, x: u32, y: u32) -> vec4<f32> {
    let inside = x < params.size.x && y < params.size.y;
    let at = y * params.size.x + x;
    return vec4(
        gradient(inside, o, at),
        gradient(inside, o + 1u, at),
        gradient(inside, o + 2u, at),
        gradient(inside, o + 3u, at),
    );
}

// Four pixels' gradients (4 outputs each) times their inputs, added.
fn add(sum: vec4<f32>, g: mat4x4<f32>, x: vec4<f32>) -> vec4<f32> {
    let half = fma(g[1], vec4(x.y), fma(g[0], vec4(x.x), sum));
    return fma(g[3], vec4(x.w), fma(g[2], vec4(x.z), half));
}

struct Sums {
    left: vec4<f32>,
    middle: vec4<f32>,
    right: vec4<f32>,
}

// The three taps of a row: the four pixels' inputs begin at now.x, now.y, now.z.
fn add_row(sums: Sums, g: mat4x4<f32>, now: vec4<f32>, next: vec4<f32>) -> Sums {
    return Sums(
        add(sums.left, g, now),
        add(sums.middle, g, vec4(now.yzw, next.x)),
        add(sums.right, g, vec4(now.zw, next.xy)),
    );
}

fn write(base: u32, o: u32, i: u32, tap: u32, sum: vec4<f32>) {
    for (var k = 0u; k < 4u; k++) {
        if o + k < params.outputs && i < params.inputs {
            partials[base + ((o + k) * params.inputs + i) * 9u + tap] = sum[k];
        }
    }
}

fn write_row(base: u32, o: u32, i: u32, tap: u32, sums: Sums) {
    write(base, o, i, tap, sums.left);
    write(base, o, i, tap + 1u, sums.middle);
    write(base, o, i, tap + 2u, sums.right);
}

@compute @workgroup_size(192)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let tiles = (params.size + vec2(15u, 1u)) / vec2(16u, 2u);
    let count = tiles.x * tiles.y;
    let share = (count + params.splits - 1u) / params.splits;
    let end = min((wid.x + 1u) * share, count);
    let quad = local % 10u;
    let pair = min(local / 10u, 18u);
    let busy = 4u * quad < params.outputs && 2u * pair < params.inputs;
    let c = 2u * pair;
    var bias = vec4(0.0);
    // Three rows of taps for each of the two inputs.
    var p0 = Sums();
    var p1 = Sums();
    var p2 = Sums();
    var q0 = Sums();
    var q1 = Sums();
    var q2 = Sums();
    for (var t = wid.x * share; t < end; t++) {
        let corner = vec2(t % tiles.x, t / tiles.x) * vec2(16u, 2u);
        workgroupBarrier();
        if local < 160u {
            load_inputs(local, vec2<i32>(corner));
            let upper = gradients(4u * (local / 16u), corner.x + local % 16u, corner.y);
            let lower = gradients(4u * (local / 16u), corner.x + local % 16u, corner.y + 1u);
            v_tile[local % 16u][local / 16u] = upper;
            v_tile[16u + local % 16u][local / 16u] = lower;
            bias += upper + lower;
        }
        workgroupBarrier();
        if busy {
            for (var row = 0u; row < 2u; row++) {
                let r = 5u * row;
                var x0 = x_tile[c][r];
                var x1 = x_tile[c][r + 5u];
                var x2 = x_tile[c][r + 10u];
                var y0 = x_tile[c + 1u][r];
                var y1 = x_tile[c + 1u][r + 5u];
                var y2 = x_tile[c + 1u][r + 10u];
                for (var k = 0u; k < 4u; k++) {
                    let pixel = 16u * row + 4u * k;
                    let g = mat4x4(
                        v_tile[pixel][quad],
                        v_tile[pixel + 1u][quad],
                        v_tile[pixel + 2u][quad],
                        v_tile[pixel + 3u][quad],
                    );
                    let at = r + k + 1u;
                    let x0_next = x_tile[c][at];
                    let x1_next = x_tile[c][at + 5u];
                    let x2_next = x_tile[c][at + 10u];
                    let y0_next = x_tile[c + 1u][at];
                    let y1_next = x_tile[c + 1u][at + 5u];
                    let y2_next = x_tile[c + 1u][at + 10u];
                    p0 = add_row(p0, g, x0, x0_next);
                    p1 = add_row(p1, g, x1, x1_next);
                    p2 = add_row(p2, g, x2, x2_next);
                    q0 = add_row(q0, g, y0, y0_next);
                    q1 = add_row(q1, g, y1, y1_next);
                    q2 = add_row(q2, g, y2, y2_next);
                    x0 = x0_next;
                    x1 = x1_next;
                    x2 = x2_next;
                    y0 = y0_next;
                    y1 = y1_next;
                    y2 = y2_next;
                }
            }
        }
    }
    let weights = params.outputs * params.inputs * 9u;
    let base = wid.x * (weights + params.outputs);
    if busy && local < 190u {
        write_row(base, 4u * quad, c, 0u, p0);
        write_row(base, 4u * quad, c, 3u, p1);
        write_row(base, 4u * quad, c, 6u, p2);
        write_row(base, 4u * quad, c + 1u, 0u, q0);
        write_row(base, 4u * quad, c + 1u, 3u, q1);
        write_row(base, 4u * quad, c + 1u, 6u, q2);
    }
    workgroupBarrier();
    if local < 160u {
        v_tile[local % 16u][local / 16u] = bias;
    }
    workgroupBarrier();
    if local < params.outputs {
        var sum = 0.0;
        for (var k = 0u; k < 16u; k++) {
            sum += v_tile[k][local / 4u][local % 4u];
        }
        partials[base + weights + local] = sum;
    }
}
