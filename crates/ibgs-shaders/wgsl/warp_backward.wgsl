//! Gradient of the warping of up to four sources by the median intersections and the median depth.
#set train
#stage warp backward
// One thread a pixel, a round of sources a dispatch: adds the gradients by the median intersections and by the median depth.
// Departs from the published code: the bilinear read is differentiated as it was done (method.md 10.3), and the cosine has a
// derivative (10.4).
#define FOUR
#import source_round
#import source_read
#import seen

/// All sources.
@group(0) @binding(0) var<storage, read> sources: array<SourceParams>;
@group(0) @binding(1) var<storage, read> median_depth: array<f32>;
@group(0) @binding(2) var<storage, read> intersections: array<vec2<f32>>;
@group(0) @binding(3) var<storage, read> warped: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> seen: array<u32>;
@group(0) @binding(5) var<storage, read> v_warped: array<vec4<f32>>;
/// By (view depth, weight).
@group(0) @binding(6) var<storage, read_write> v_intersections: array<vec2<f32>>;
@group(0) @binding(7) var<storage, read_write> v_median_depth: array<f32>;
@group(0) @binding(8) var<storage, read> photo0: array<u32>;
/// The second source of the round; where there is none any photo.
@group(0) @binding(9) var<storage, read> photo1: array<u32>;
/// The third.
@group(0) @binding(10) var<storage, read> photo2: array<u32>;
/// The fourth.
@group(0) @binding(11) var<storage, read> photo3: array<u32>;

// Adds the gradients by the intersections of a pixel's m-th visible source.
fn add_intersections(p: u32, m: u32, ray: vec3<f32>, v: vec3<f32>) {
    let plane = warping.size.x * warping.size.y;
    let mean = dot(v, warped[m * plane + p].rgb);
    let weights = read_weights(p, ray, v);
    for (var k = 0u; k < warping.intersections; k++) {
        let at = k * plane + p;
        let intersection = intersections[at];
        let l = land(ray, intersection.x);
        if intersection.y > 0.0 && l.inside {
            let read = read_photo(l, v);
            if read.valid {
                v_intersections[at] += vec2(dot(read.slope, l.slope) * intersection.y, read.color - mean) / weights;
            }
        }
    }
}

@compute @workgroup_size(TILE, TILE)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= warping.size) {
        return;
    }
    let plane = warping.size.x * warping.size.y;
    let p = id.y * warping.size.x + id.x;
    let packed = seen[p];
    // A pixel's visible sources come in order of their numbers; where there is none the number is 15.
    var m = 0u;
    while m < warping.visible && seen_source(packed, m) < warping.first {
        m++;
    }
    if m == warping.visible || seen_source(packed, m) >= warping.first + warping.count {
        return;
    }
    let z = median_depth[p];
    var v_z = v_median_depth[p];
    for (var s = 0u; s < warping.count; s++) {
        if m < warping.visible && seen_source(packed, m) == warping.first + s {
            take_source(s);
            let v = v_warped[m * plane + p];
            let ray = source_ray(id.xy);
            v_z += v.w * ray_cosine(ray, z).y;
            add_intersections(p, m, ray, v.rgb);
            m++;
        }
    }
    v_median_depth[p] = v_z;
}
