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

// Gradients by the pixel's intersections, of which there are at most eight.
var<private> sums: array<vec2<f32>, 8>;

// What a source shows of four intersections: their weights, zero where it shows nothing, the gradient by the colour read
// times the colour, and the gradient by the depth over the weight.
struct Four {
    weight: vec4<f32>,
    color: vec4<f32>,
    along: vec4<f32>,
}

// All four at once, so that their reads do not wait for each other.
fn read_four(p: u32, first: u32, ray: vec3<f32>, v: vec3<f32>) -> Four {
    let plane = warping.size.x * warping.size.y;
    #repeat k 4
    let i$k = intersections[min(first + $ku, warping.intersections - 1u) * plane + p];
    let l$k = land(ray, i$k.x);
    let read$k = read_photo(l$k, v);
    let counts$k = first + $ku < warping.intersections && i$k.y > 0.0 && l$k.inside && read$k.valid;
    #end
    var four: Four;
    #repeat k 4
    four.weight[$k] = select(0.0, i$k.y, counts$k);
    four.color[$k] = read$k.color;
    four.along[$k] = dot(read$k.slope, l$k.slope);
    #end
    return four;
}

// Adds the gradients by the intersections of a pixel's m-th visible source.
fn add_source(p: u32, m: u32, ray: vec3<f32>, v: vec3<f32>) {
    let mean = dot(v, warped[m * warping.size.x * warping.size.y + p].rgb);
    let near = read_four(p, 0u, ray, v);
    var far: Four;
    if warping.intersections > 4u {
        far = read_four(p, 4u, ray, v);
    }
    var weights = SOURCE_EPSILON;
    #repeat k 4
    weights += near.weight[$k];
    #end
    #repeat k 4
    weights += far.weight[$k];
    #end
    #repeat k 4
    if near.weight[$k] > 0.0 {
        sums[$k] += vec2(near.along[$k] * near.weight[$k], near.color[$k] - mean) / weights;
    }
    if far.weight[$k] > 0.0 {
        sums[4 + $k] += vec2(far.along[$k] * far.weight[$k], far.color[$k] - mean) / weights;
    }
    #end
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
    #repeat k 8
    if $ku < warping.intersections {
        sums[$k] = v_intersections[$ku * plane + p];
    }
    #end
    for (var s = 0u; s < warping.count; s++) {
        if m < warping.visible && seen_source(packed, m) == warping.first + s {
            take_source(s);
            let v = v_warped[m * plane + p];
            let ray = source_ray(id.xy);
            v_z += v.w * ray_cosine(ray, z).y;
            add_source(p, m, ray, v.rgb);
            m++;
        }
    }
    v_median_depth[p] = v_z;
    #repeat k 8
    if $ku < warping.intersections {
        v_intersections[$ku * plane + p] = sums[$k];
    }
    #end
}
