// The kernel of the U-Net's last two layers. It hands each channel of f to the `keep` of the file that imports it.
#import index
#import residual_head_kernel
#import residual_map

// Rows: pixels, columns: output channels.
fn add(m: mat4x4<f32>, w: vec4<f32>, values: vec4<f32>) -> mat4x4<f32> {
    return mat4x4(
        fma(vec4(w.x), values, m[0]),
        fma(vec4(w.y), values, m[1]),
        fma(vec4(w.z), values, m[2]),
        fma(vec4(w.w), values, m[3]),
    );
}

fn bias(o: u32) -> vec4<f32> {
    return vec4(weights[params.fuse_bias + min(o, WIDTH - 1u)]);
}

// ReLU of four channels, with their bias. The channels over 38 have no weights in the last layer.
fn finish(quad: u32, pixels: vec4<u32>, m: mat4x4<f32>) -> mat4x4<f32> {
    let o = 4u * quad;
    let zero = vec4(0.0);
    let r = mat4x4(
        max(m[0] + bias(o), zero),
        max(m[1] + bias(o + 1u), zero),
        max(m[2] + bias(o + 2u), zero),
        max(m[3] + bias(o + 3u), zero),
    );
    keep(o, pixels, r[0]);
    keep(o + 1u, pixels, r[1]);
    keep(o + 2u, pixels, r[2]);
    keep(o + 3u, pixels, r[3]);
    return r;
}

@compute @workgroup_size(128)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    load_head(local);
    let p = pixels_of(linear_workgroup(wid, groups), local);
    var m0 = mat4x4<f32>();
    var m1 = mat4x4<f32>();
    var m2 = mat4x4<f32>();
    var m3 = mat4x4<f32>();
    var m4 = mat4x4<f32>();
    var m5 = mat4x4<f32>();
    var m6 = mat4x4<f32>();
    var m7 = mat4x4<f32>();
    var m8 = mat4x4<f32>();
    var m9 = mat4x4<f32>();
    // Beyond the end the last pixel is read, and nothing written.
    let q = min(p, vec4(params.pixels - 1u));
    for (var i = 0u; i < WIDTH; i++) {
        let at = q + (i / CHANNELS) * params.pixels;
        let left = vec4(number(d1[at.x], i), number(d1[at.y], i), number(d1[at.z], i), number(d1[at.w], i));
        let right = vec4(number(x[at.x], i), number(x[at.y], i), number(x[at.z], i), number(x[at.w], i));
        m0 = add(m0, fuse[i][0], left);
        m1 = add(m1, fuse[i][1], left);
        m2 = add(m2, fuse[i][2], left);
        m3 = add(m3, fuse[i][3], left);
        m4 = add(m4, fuse[i][4], left);
        m5 = add(m5, fuse[i][5], left);
        m6 = add(m6, fuse[i][6], left);
        m7 = add(m7, fuse[i][7], left);
        m8 = add(m8, fuse[i][8], left);
        m9 = add(m9, fuse[i][9], left);
        m0 = add(m0, fuse[i + WIDTH][0], right);
        m1 = add(m1, fuse[i + WIDTH][1], right);
        m2 = add(m2, fuse[i + WIDTH][2], right);
        m3 = add(m3, fuse[i + WIDTH][3], right);
        m4 = add(m4, fuse[i + WIDTH][4], right);
        m5 = add(m5, fuse[i + WIDTH][5], right);
        m6 = add(m6, fuse[i + WIDTH][6], right);
        m7 = add(m7, fuse[i + WIDTH][7], right);
        m8 = add(m8, fuse[i + WIDTH][8], right);
        m9 = add(m9, fuse[i + WIDTH][9], right);
    }
    m0 = finish(0u, p, m0);
    m1 = finish(1u, p, m1);
    m2 = finish(2u, p, m2);
    m3 = finish(3u, p, m3);
    m4 = finish(4u, p, m4);
    m5 = finish(5u, p, m5);
    m6 = finish(6u, p, m6);
    m7 = finish(7u, p, m7);
    m8 = finish(8u, p, m8);
    m9 = finish(9u, p, m9);
    // Rows: pixels, columns: outputs.
    var given = mat4x4<f32>();
    for (var c = 0u; c < OUTPUTS; c++) {
        var sum = m0 * last[c][0] + m1 * last[c][1] + m2 * last[c][2] + m3 * last[c][3] + m4 * last[c][4];
        sum += m5 * last[c][5] + m6 * last[c][6] + m7 * last[c][7] + m8 * last[c][8] + m9 * last[c][9];
        given[c] = sum + weights[params.last_bias + c];
    }
    let rows = transpose(given);
    for (var k = 0u; k < 4u; k++) {
        if p[k] < params.pixels {
            residual[p[k]] = rows[k];
        }
    }
}
