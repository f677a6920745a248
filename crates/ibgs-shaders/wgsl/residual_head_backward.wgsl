//! The U-Net's last two layers, gradient by their inputs.
#set train
#stage unet backward
// One thread four pixels: gradients by the two inputs of the U-Net's last two layers. Each takes the place of what it
// was made from at the same pixel: d1 becomes v_d1 (through its ReLU), f becomes v_x.
#import index
#import residual_head_kernel

@group(0) @binding(0) var<storage, read> weights: array<f32>;
@group(0) @binding(1) var<storage, read> v_residual: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> d1: array<f32>;
@group(0) @binding(3) var<storage, read_write> f: array<f32>;

// Rows: outputs, columns: pixels.
fn upstream(p: vec4<u32>) -> mat4x4<f32> {
    return mat4x4(v_residual[p.x], v_residual[p.y], v_residual[p.z], v_residual[p.w]);
}

// Channels over 38 have no weights in the last layer, so it does not matter what is read for them.
fn feature(o: u32, p: vec4<u32>) -> vec4<f32> {
    let i = min(o, WIDTH - 1u) * params.pixels + p;
    return vec4(f[i.x], f[i.y], f[i.z], f[i.w]);
}

// v_f of one channel before its ReLU.
fn masked(o: u32, p: vec4<u32>, v: vec4<f32>) -> vec4<f32> {
    return select(vec4(0.0), v, feature(o, p) > vec4(0.0));
}

// Rows: pixels, columns: channels of f. v: gradients by the outputs, rows: outputs, columns: pixels.
fn gradient(quad: u32, p: vec4<u32>, v: mat4x4<f32>) -> mat4x4<f32> {
    let o = 4u * quad;
    // Rows: channels, columns: outputs.
    let w = mat4x4(last[0][quad], last[1][quad], last[2][quad], last[3][quad]);
    let sums = transpose(w * v);
    return mat4x4(
        masked(o, p, sums[0]),
        masked(o + 1u, p, sums[1]),
        masked(o + 2u, p, sums[2]),
        masked(o + 3u, p, sums[3]),
    );
}

fn add(sum: vec4<f32>, m: mat4x4<f32>, w: vec4<f32>) -> vec4<f32> {
    let half = fma(m[1], vec4(w.y), fma(m[0], vec4(w.x), sum));
    return fma(m[3], vec4(w.w), fma(m[2], vec4(w.z), half));
}

// Both inputs' gradients of one pixel.
fn put(i: u32, p: u32, activation: f32, left: f32, right: f32) {
    if p < params.pixels {
        d1[i * params.pixels + p] = select(0.0, left, activation > 0.0);
        f[i * params.pixels + p] = right;
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
    // Beyond the end the last pixel is read, and nothing written.
    let q = min(p, vec4(params.pixels - 1u));
    let v = upstream(q);
    let m0 = gradient(0u, q, v);
    let m1 = gradient(1u, q, v);
    let m2 = gradient(2u, q, v);
    let m3 = gradient(3u, q, v);
    let m4 = gradient(4u, q, v);
    let m5 = gradient(5u, q, v);
    let m6 = gradient(6u, q, v);
    let m7 = gradient(7u, q, v);
    let m8 = gradient(8u, q, v);
    let m9 = gradient(9u, q, v);
    for (var i = 0u; i < WIDTH; i++) {
        let at = q + i * params.pixels;
        let activation = vec4(d1[at.x], d1[at.y], d1[at.z], d1[at.w]);
        var left = add(vec4(0.0), m0, fuse[i][0]);
        var right = add(vec4(0.0), m0, fuse[i + WIDTH][0]);
        left = add(left, m1, fuse[i][1]);
        right = add(right, m1, fuse[i + WIDTH][1]);
        left = add(left, m2, fuse[i][2]);
        right = add(right, m2, fuse[i + WIDTH][2]);
        left = add(left, m3, fuse[i][3]);
        right = add(right, m3, fuse[i + WIDTH][3]);
        left = add(left, m4, fuse[i][4]);
        right = add(right, m4, fuse[i + WIDTH][4]);
        left = add(left, m5, fuse[i][5]);
        right = add(right, m5, fuse[i + WIDTH][5]);
        left = add(left, m6, fuse[i][6]);
        right = add(right, m6, fuse[i + WIDTH][6]);
        left = add(left, m7, fuse[i][7]);
        right = add(right, m7, fuse[i + WIDTH][7]);
        left = add(left, m8, fuse[i][8]);
        right = add(right, m8, fuse[i + WIDTH][8]);
        left = add(left, m9, fuse[i][9]);
        right = add(right, m9, fuse[i + WIDTH][9]);
        put(i, p.x, activation.x, left.x, right.x);
        put(i, p.y, activation.y, left.y, right.y);
        put(i, p.z, activation.z, left.z, right.z);
        put(i, p.w, activation.w, left.w, right.w);
    }
}
