// In blocks of 32 pixels; a thread owns 4 outputs x 4 inputs of the first layer.

const BLOCK: u32 = 32u;

// [pixel][input quad], and v_f as [pixel][output quad], one more against bank conflicts.
var<workgroup> x_tile: array<array<vec4<f32>, 19>, BLOCK>;
var<workgroup> v_tile: array<array<vec4<f32>, 11>, BLOCK>;

fn input(i: u32, p: u32) -> f32 {
    if i < WIDTH {
        return d1[i * params.pixels + p];
    }
    return x[min(i - WIDTH, WIDTH - 1u) * params.pixels + p];
}

// Four inputs of a pixel; beyond the end those of the last pixel, whose gradient is then zero.
fn inputs(quad: u32, p: u32) -> vec4<f32> {
    let i = 4u * quad;
    return vec4(input(i, p), input(i + 1u, p), input(i + 2u, p), input(i + 3u, p));
}

fn load_inputs(local: u32, begin: u32) {
    let pixel = local % BLOCK;
    let quad = local / BLOCK;
    let p = min(begin + pixel, params.pixels - 1u);
    let t0 = inputs(quad, p);
    let t1 = inputs(quad + 6u, p);
    let t2 = inputs(quad + 12u, p);
    x_tile[pixel][quad] = t0;
    x_tile[pixel][quad + 6u] = t1;
    x_tile[pixel][quad + 12u] = t2;
    if quad == 0u {
        x_tile[pixel][18] = inputs(18u, p);
    }
}

fn features(o: u32, p: u32) -> vec4<f32> {
    let end = WIDTH - 1u;
    let n = params.pixels;
    return vec4(f[o * n + p], f[(o + 1u) * n + p], f[min(o + 2u, end) * n + p], f[min(o + 3u, end) * n + p]);
}

fn last_weight(c: u32, o: u32) -> vec4<f32> {
    let row = params.last + c * WIDTH;
    let end = WIDTH - 1u;
    return vec4(weights[row + o], weights[row + o + 1u], weights[row + min(o + 2u, end)], weights[row + min(o + 3u, end)]);
}

// Adds v_tile over 16 pixels: one quad of channels in each of the first ten rows, to channels of at most `limit`.
fn reduce(local: u32, value: vec4<f32>, base: u32, limit: u32) {
    workgroupBarrier();
    if local < 160u {
        v_tile[local % 16u][local / 16u] = value;
    }
    workgroupBarrier();
    if local < limit {
        var sum = 0.0;
        for (var k = 0u; k < 16u; k++) {
            sum += v_tile[k][local / 4u][local % 4u];
        }
        partials[base + local] = sum;
    }
}

fn write(base: u32, quad: u32, i: u32, sum: vec4<f32>) {
    for (var k = 0u; k < 4u; k++) {
        if 4u * quad + k < WIDTH {
            partials[base + (4u * quad + k) * INPUTS + i] = sum[k];
        }
    }
}

@compute @workgroup_size(192)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let count = (params.pixels + BLOCK - 1u) / BLOCK;
    let share = (count + groups.x - 1u) / groups.x;
    let end = min((wid.x + 1u) * share, count);
    // Loading: a quad of f and one of 16 pixels. Computing: a quad of outputs and a quad of inputs.
    let feature_quad = 4u * min(local / 16u, 9u);
    let w0 = last_weight(0u, feature_quad);
    let w1 = last_weight(1u, feature_quad);
    let w2 = last_weight(2u, feature_quad);
    let w3 = last_weight(3u, feature_quad);
    let quad = local % 10u;
    let input_quad = min(local / 10u, 18u);
    var bias = vec4(0.0);
    var last0 = vec4(0.0);
    var last1 = vec4(0.0);
    var last2 = vec4(0.0);
    var last3 = vec4(0.0);
    var last_bias = vec4(0.0);
    var s0 = vec4(0.0);
    var s1 = vec4(0.0);
    var s2 = vec4(0.0);
    var s3 = vec4(0.0);
    for (var t = wid.x * share; t < end; t++) {
        workgroupBarrier();
        load_inputs(local, t * BLOCK);
        if local < 160u {
            for (var pixel = local % 16u; pixel < BLOCK; pixel += 16u) {
                let inside = t * BLOCK + pixel < params.pixels;
                let p = min(t * BLOCK + pixel, params.pixels - 1u);
                let value = features(feature_quad, p);
                let v = select(vec4(0.0), v_residual[p], inside);
                let v_f = select(vec4(0.0), v.x * w0 + v.y * w1 + v.z * w2 + v.w * w3, value > vec4(0.0));
                v_tile[pixel][local / 16u] = v_f;
                bias += v_f;
                last0 += v.x * value;
                last1 += v.y * value;
                last2 += v.z * value;
                last3 += v.w * value;
                last_bias += v;
            }
        }
        workgroupBarrier();
        for (var pixel = 0u; pixel < BLOCK; pixel++) {
            let v = v_tile[pixel][quad];
            let values = x_tile[pixel][input_quad];
            s0 = fma(v, vec4(values.x), s0);
            s1 = fma(v, vec4(values.y), s1);
            s2 = fma(v, vec4(values.z), s2);
            s3 = fma(v, vec4(values.w), s3);
        }
    }
    let base = wid.x * STRIDE;
    if local < 190u {
        write(base, quad, 4u * input_quad, s0);
        write(base, quad, 4u * input_quad + 1u, s1);
        write(base, quad, 4u * input_quad + 2u, s2);
        write(base, quad, 4u * input_quad + 3u, s3);
    }
    let behind = base + WIDTH * INPUTS;
    reduce(local, bias, behind, WIDTH);
    reduce(local, last0, behind + WIDTH, WIDTH);
    reduce(local, last1, behind + 2u * WIDTH, WIDTH);
    reduce(local, last2, behind + 3u * WIDTH, WIDTH);
    reduce(local, last3, behind + 4u * WIDTH, WIDTH);
    reduce(local, last_bias, behind + 5u * WIDTH, OUTPUTS);
}
