// A fixed number of workgroups, each over its share of the pixels whose first slot holds the first source: count and
// sums of base colour x and warped colour y, then sums of products about the workgroup's own means. About those means
// nothing cancels, however flat the picture.
#import reduce
#import seen

var<immediate> pixels: u32;

@group(0) @binding(0) var<storage, read> base: array<f32>;
// [V, P, 4], of which slot 0 is read.
@group(0) @binding(1) var<storage, read> warped: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> seen: array<u32>;
// Rows of seven, the moments of exposure_solve.
@group(0) @binding(3) var<storage, read_write> partials: array<vec4<f32>>;

fn first_visible(p: u32) -> bool {
    return slot_source(seen[p], 0u) == 0u;
}

fn base_color(p: u32) -> vec3<f32> {
    return vec3(base[3u * p], base[3u * p + 1u], base[3u * p + 2u]);
}

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let first = wid.x * 256u + local;
    let stride = EXPOSURE_GROUPS * 256u;
    var sum_x = vec4(0.0);
    var sum_y = vec4(0.0);
    for (var p = first; p < pixels; p += stride) {
        if first_visible(p) {
            sum_x += vec4(base_color(p), 1.0);
            sum_y += vec4(warped[p].xyz, 0.0);
        }
    }
    let total_x = reduce(local, sum_x);
    let total_y = reduce(local, sum_y);
    let count = max(total_x.w, 1.0);
    let mean_x = total_x.xyz / count;
    let mean_y = total_y.xyz / count;
    var xx = vec4(0.0);
    var yz = vec4(0.0);
    var by_red = vec4(0.0);
    var by_green = vec4(0.0);
    var by_blue = vec4(0.0);
    for (var p = first; p < pixels; p += stride) {
        if first_visible(p) {
            let d = base_color(p) - mean_x;
            let e = warped[p].xyz - mean_y;
            xx += vec4(d.x * d, d.y * d.y);
            yz += vec4(d.y * d.z, d.z * d.z, 0.0, 0.0);
            by_red += vec4(e.x * d, 0.0);
            by_green += vec4(e.y * d, 0.0);
            by_blue += vec4(e.z * d, 0.0);
        }
    }
    let moments = array<vec4<f32>, 5>(
        reduce(local, xx), reduce(local, yz), reduce(local, by_red), reduce(local, by_green), reduce(local, by_blue),
    );
    if local == 0u {
        let row = 7u * wid.x;
        partials[row] = total_x;
        partials[row + 1u] = total_y;
        for (var i = 0u; i < 5u; i++) {
            partials[row + 2u + i] = moments[i];
        }
    }
}
