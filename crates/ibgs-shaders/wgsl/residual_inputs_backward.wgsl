//! Gradient by warped colours, cosines and base colour.
#set train
#stage features backward
// One thread a pixel of the image: the resize of features and base colour transposed as a gather, then the gradient by
// warped colours and cosines (assigned) and by the base colour (added). With OUTPUT_GATED also through the sources' mean
// difference.
#import index
#import residual_input
#import residual_difference

@group(0) @binding(0) var<storage, read> seen: array<u32>;
@group(0) @binding(1) var<storage, read> most_visible: array<u32>;
/// Gradient by the U-Net's input: planes of the network's size, three of them from params.base_plane on.
@group(0) @binding(2) var<storage, read> v_x: array<f32>;
@group(0) @binding(3) var<storage, read> v_features: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> base: array<f32>;
@group(0) @binding(5) var<storage, read> warped: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> residual: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> v_image: array<f32>;
@group(0) @binding(8) var<storage, read_write> v_warped: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read_write> v_base: array<f32>;

struct Sums {
    base: vec3<f32>,
    source0: vec4<f32>,
    source1: vec4<f32>,
    source2: vec4<f32>,
    source3: vec4<f32>,
}

fn of_source(m: u32, used: u32, q: u32) -> vec4<f32> {
    if m >= used {
        return vec4(0.0);
    }
    return v_features[m * params.low.x * params.low.y + q];
}

fn add(q: u32, used: u32, weight: f32, sums: ptr<function, Sums>) {
    let plane = params.low.x * params.low.y;
    let at = params.base_plane * plane + q;
    (*sums).base += weight * vec3(v_x[at], v_x[at + plane], v_x[at + 2u * plane]);
    (*sums).source0 += weight * of_source(0u, used, q);
    (*sums).source1 += weight * of_source(1u, used, q);
    (*sums).source2 += weight * of_source(2u, used, q);
    (*sums).source3 += weight * of_source(3u, used, q);
}

// The gradient by the mean difference, and the mean difference with its sum of weights.
struct Gated {
    v: vec3<f32>,
    mean: vec4<f32>,
}

fn gated(p: u32) -> Gated {
    if params.output != OUTPUT_GATED {
        return Gated(vec3(0.0), vec4(1.0));
    }
    let v = vec3(v_image[3u * p], v_image[3u * p + 1u], v_image[3u * p + 2u]);
    return Gated(sigmoid(output_at(p).w) * v, mean_difference(p));
}

// Writes one source's gradient and gives its share of the base colour's.
fn put(m: u32, p: u32, v: vec4<f32>, through: Gated) -> vec3<f32> {
    if m >= params.visible {
        return vec3(0.0);
    }
    let at = m * params.size.x * params.size.y + p;
    if !is_seen(seen[p], m) {
        v_warped[at] = vec4(0.0);
        return vec3(0.0);
    }
    var of_mean = vec4(0.0);
    if params.output == OUTPUT_GATED {
        let d = difference(p, m);
        let weight = d.w / through.mean.w;
        of_mean = weight * vec4(through.v, dot(through.v, d.xyz - through.mean.xyz) / SPREAD);
    }
    v_warped[at] = v + of_mean;
    return -v.rgb - of_mean.rgb;
}

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let p = linear_workgroup(wid, groups) * 256u + local;
    if p >= params.size.x * params.size.y {
        return;
    }
    let used = used_sources();
    let z = vec4(0.0);
    var sums = Sums(vec3(0.0), z, z, z, z);
    if resized() {
        let pixel = vec2(p % params.size.x, p / params.size.x);
        let columns = resize_readers(pixel.x, params.size.x, params.low.x);
        let rows = resize_readers(pixel.y, params.size.y, params.low.y);
        for (var y = rows.x; y <= rows.y; y++) {
            let down = resize_weight(y, pixel.y, params.size.y, params.low.y);
            for (var x = columns.x; x <= columns.y; x++) {
                let weight = down * resize_weight(x, pixel.x, params.size.x, params.low.x);
                add(y * params.low.x + x, used, weight, &sums);
            }
        }
    } else {
        add(p, used, 1.0, &sums);
    }
    var v = sums.base;
    let through = gated(p);
    v += put(0u, p, sums.source0, through) + put(1u, p, sums.source1, through);
    v += put(2u, p, sums.source2, through) + put(3u, p, sums.source3, through);
    v_base[3u * p] += v.x;
    v_base[3u * p + 1u] += v.y;
    v_base[3u * p + 2u] += v.z;
}
