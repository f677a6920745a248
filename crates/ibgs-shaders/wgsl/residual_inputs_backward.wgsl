// One thread a pixel of the image: the resize of features and base colour transposed as a gather, then the gradient by
// warped colours and cosines (assigned) and by the base colour (added).
#import index
#import residual_input

@group(0) @binding(0) var<storage, read> seen: array<u32>;
@group(0) @binding(1) var<storage, read> most_visible: array<u32>;
// Planes [38][pixels of the network's size].
@group(0) @binding(2) var<storage, read> v_x: array<f32>;
@group(0) @binding(3) var<storage, read> v_features: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> v_warped: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> v_base: array<f32>;

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
    let at = BASE_CHANNEL * plane + q;
    (*sums).base += weight * vec3(v_x[at], v_x[at + plane], v_x[at + 2u * plane]);
    (*sums).source0 += weight * of_source(0u, used, q);
    (*sums).source1 += weight * of_source(1u, used, q);
    (*sums).source2 += weight * of_source(2u, used, q);
    (*sums).source3 += weight * of_source(3u, used, q);
}

// Writes one source's gradient and gives its share of the base colour's.
fn put(m: u32, p: u32, v: vec4<f32>) -> vec3<f32> {
    if m >= params.visible {
        return vec3(0.0);
    }
    let own = select(vec4(0.0), v, is_seen(seen[p], m));
    v_warped[m * params.size.x * params.size.y + p] = own;
    return select(-own.rgb, vec3(0.0), params.inputs == INPUTS_SOURCE_COLORS);
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
    var v = select(sums.base, vec3(0.0), params.inputs == INPUTS_DIFFERENCES_ONLY);
    v += put(0u, p, sums.source0) + put(1u, p, sums.source1) + put(2u, p, sums.source2) + put(3u, p, sums.source3);
    v_base[3u * p] += v.x;
    v_base[3u * p + 1u] += v.y;
    v_base[3u * p + 2u] += v.z;
}
