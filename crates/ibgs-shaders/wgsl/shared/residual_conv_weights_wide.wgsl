// A workgroup goes through tiles of 16 x 2 pixels. A thread owns 4 outputs x 2 inputs x 9 taps (18 registers of four outputs) and
// slides along the tile's rows four pixels at a time.
#import residual_weights_tile

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

// All taps of two inputs, a row each.
struct Taps {
    p0: Sums,
    p1: Sums,
    p2: Sums,
    q0: Sums,
    q1: Sums,
    q2: Sums,
}

// Four columns x three rows of two inputs.
struct Window {
    p0: vec4<f32>,
    p1: vec4<f32>,
    p2: vec4<f32>,
    q0: vec4<f32>,
    q1: vec4<f32>,
    q2: vec4<f32>,
}

fn window(c: u32, at: u32) -> Window {
    return Window(
        x_tile[c][at],
        x_tile[c][at + 5u],
        x_tile[c][at + 10u],
        x_tile[c + 1u][at],
        x_tile[c + 1u][at + 5u],
        x_tile[c + 1u][at + 10u],
    );
}

// Four pixels of a row: their inputs lie in `now` and `next`.
fn add_pixels(taps: Taps, pixel: u32, quad: u32, now: Window, next: Window) -> Taps {
    let g = mat4x4(v_tile[pixel][quad], v_tile[pixel + 1u][quad], v_tile[pixel + 2u][quad], v_tile[pixel + 3u][quad]);
    return Taps(
        add_row(taps.p0, g, now.p0, next.p0),
        add_row(taps.p1, g, now.p1, next.p1),
        add_row(taps.p2, g, now.p2, next.p2),
        add_row(taps.q0, g, now.q0, next.q0),
        add_row(taps.q1, g, now.q1, next.q1),
        add_row(taps.q2, g, now.q2, next.q2),
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
    var taps = Taps();
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
                var now = window(c, 5u * row);
                for (var k = 0u; k < 2u; k++) {
                    let pixel = 16u * row + 8u * k;
                    let at = 5u * row + 2u * k;
                    let middle = window(c, at + 1u);
                    taps = add_pixels(taps, pixel, quad, now, middle);
                    now = window(c, at + 2u);
                    taps = add_pixels(taps, pixel + 4u, quad, middle, now);
                }
            }
        }
    }
    let weights = params.outputs * params.inputs * 9u;
    let base = wid.x * (weights + params.outputs);
    if busy && local < 190u {
        write_row(base, 4u * quad, c, 0u, taps.p0);
        write_row(base, 4u * quad, c, 3u, taps.p1);
        write_row(base, 4u * quad, c, 6u, taps.p2);
        write_row(base, 4u * quad, c + 1u, 0u, taps.q0);
        write_row(base, 4u * quad, c + 1u, 3u, taps.q1);
        write_row(base, 4u * quad, c + 1u, 6u, taps.q2);
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
