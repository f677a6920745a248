//! Gradient of one source's warping by the median intersections and the median depth.
#set train
#stage warp backward
// One thread a pixel, one source a dispatch: adds the gradients by the median intersections and by the median depth. Departs
// from the published code: the bilinear read is differentiated as it was done (method.md 10.3), and the cosine has a
// derivative (10.4).
#import source
#import seen
#import source_read

@group(0) @binding(0) var<storage, read> median_depth: array<f32>;
@group(0) @binding(1) var<storage, read> intersections: array<vec2<f32>>;
@group(0) @binding(2) var<storage, read> photo: array<u32>;
@group(0) @binding(3) var<storage, read> warped: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> seen: array<u32>;
@group(0) @binding(5) var<storage, read> v_warped: array<vec4<f32>>;
/// By (view depth, weight).
@group(0) @binding(6) var<storage, read_write> v_intersections: array<vec2<f32>>;
@group(0) @binding(7) var<storage, read_write> v_median_depth: array<f32>;

@compute @workgroup_size(TILE, TILE)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= params.size) {
        return;
    }
    let plane = params.size.x * params.size.y;
    let p = id.y * params.size.x + id.x;
    // Which of the visible sources of this pixel this one is.
    var m = 0u;
    while m < params.visible && seen_source(seen[p], m) != params.index {
        m++;
    }
    if m == params.visible {
        return;
    }
    let v = v_warped[m * plane + p];
    let ray = source_ray(id.xy);
    let z = median_depth[p];
    v_median_depth[p] += v.w * ray_cosine(ray, z).y;
    let mean = dot(v.rgb, warped[m * plane + p].rgb);
    let weights = read_weights(p, ray, v.rgb);
    for (var k = 0u; k < params.intersections; k++) {
        let at = k * plane + p;
        let intersection = intersections[at];
        let l = land(ray, intersection.x);
        if intersection.y > 0.0 && l.inside {
            let read = read_photo(l, v.rgb);
            if read.valid {
                v_intersections[at] += vec2(dot(read.slope, l.slope) * intersection.y, read.color - mean) / weights;
            }
        }
    }
}
