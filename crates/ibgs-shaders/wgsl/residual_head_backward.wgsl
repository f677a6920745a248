// One thread four pixels: gradients by the two inputs of the hourglass' last two layers. Each takes the place of what it
// was made from at the same pixel: d1 becomes v_d1 (through its ReLU), f becomes v_x.
#import index
#import residual_head_kernel

@group(0) @binding(0) var<storage, read> weights: array<f32>;
@group(0) @binding(1) var<storage, read> v_residual: array<f32>;
@group(0) @binding(2) var<storage, read_write> d1: array<f32>;
@group(0) @binding(3) var<storage, read_write> f: array<f32>;

fn upstream(c: u32, p: u32) -> f32 {
    if p >= params.pixels {
        return 0.0;
    }
    return v_residual[3u * p + c];
}

fn feature(o: u32, p: u32) -> f32 {
    if o >= WIDTH || p >= params.pixels {
        return 0.0;
    }
    return f[o * params.pixels + p];
}

// v_f of one channel before its ReLU.
fn masked(o: u32, p: vec4<u32>, v: vec4<f32>) -> vec4<f32> {
    let value = vec4(feature(o, p.x), feature(o, p.y), feature(o, p.z), feature(o, p.w));
    return select(vec4(0.0), v, value > vec4(0.0));
}

// Rows: pixels, columns: channels of f. v: gradients by the three channels of the residual.
fn gradient(quad: u32, p: vec4<u32>, v0: vec4<f32>, v1: vec4<f32>, v2: vec4<f32>) -> mat4x4<f32> {
    let o = 4u * quad;
    let r = last[0][quad];
    let g = last[1][quad];
    let b = last[2][quad];
    return mat4x4(
        masked(o, p, r.x * v0 + g.x * v1 + b.x * v2),
        masked(o + 1u, p, r.y * v0 + g.y * v1 + b.y * v2),
        masked(o + 2u, p, r.z * v0 + g.z * v1 + b.z * v2),
        masked(o + 3u, p, r.w * v0 + g.w * v1 + b.w * v2),
    );
}

fn add(sum: vec4<f32>, m: mat4x4<f32>, w: vec4<f32>) -> vec4<f32> {
    let half = fma(m[1], vec4(w.y), fma(m[0], vec4(w.x), sum));
    return fma(m[3], vec4(w.w), fma(m[2], vec4(w.z), half));
}

fn put(i: u32, p: u32, v: f32) {
    if p >= params.pixels {
        return;
    }
    if i < WIDTH {
        let at = i * params.pixels + p;
        d1[at] = select(0.0, v, d1[at] > 0.0);
    } else {
        f[(i - WIDTH) * params.pixels + p] = v;
    }
}

@compute @workgroup_size(128)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    load_head(local);
    let p = pixels_of(linear_workgroup(wid, groups), local);
    let v0 = vec4(upstream(0u, p.x), upstream(0u, p.y), upstream(0u, p.z), upstream(0u, p.w));
    let v1 = vec4(upstream(1u, p.x), upstream(1u, p.y), upstream(1u, p.z), upstream(1u, p.w));
    let v2 = vec4(upstream(2u, p.x), upstream(2u, p.y), upstream(2u, p.z), upstream(2u, p.w));
    let m0 = gradient(0u, p, v0, v1, v2);
    let m1 = gradient(1u, p, v0, v1, v2);
    let m2 = gradient(2u, p, v0, v1, v2);
    let m3 = gradient(3u, p, v0, v1, v2);
    let m4 = gradient(4u, p, v0, v1, v2);
    let m5 = gradient(5u, p, v0, v1, v2);
    let m6 = gradient(6u, p, v0, v1, v2);
    let m7 = gradient(7u, p, v0, v1, v2);
    let m8 = gradient(8u, p, v0, v1, v2);
    let m9 = gradient(9u, p, v0, v1, v2);
    for (var i = 0u; i < INPUTS; i++) {
        var sum = add(vec4(0.0), m0, fuse[i][0]);
        sum = add(sum, m1, fuse[i][1]);
        sum = add(sum, m2, fuse[i][2]);
        sum = add(sum, m3, fuse[i][3]);
        sum = add(sum, m4, fuse[i][4]);
        sum = add(sum, m5, fuse[i][5]);
        sum = add(sum, m6, fuse[i][6]);
        sum = add(sum, m7, fuse[i][7]);
        sum = add(sum, m8, fuse[i][8]);
        sum = add(sum, m9, fuse[i][9]);
        put(i, p.x, sum.x);
        put(i, p.y, sum.y);
        put(i, p.z, sum.z);
        put(i, p.w, sum.w);
    }
}
