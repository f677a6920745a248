//! Gradient of one source's warping by the cameras of target and source.
#set train
#stage warp backward
// A fixed number of workgroups, each over its share of the pixels. The directions that the network reads are constants.
#import source
#import seen
#import source_read
#import camera_sums

@group(0) @binding(0) var<storage, read> median_depth: array<f32>;
@group(0) @binding(1) var<storage, read> intersections: array<vec2<f32>>;
@group(0) @binding(2) var<storage, read> photo: array<u32>;
@group(0) @binding(3) var<storage, read> seen: array<u32>;
@group(0) @binding(4) var<storage, read> v_warped: array<vec4<f32>>;
/// Three rows of the target's camera, three of the source's.
@group(0) @binding(5) var<storage, read_write> partials: array<vec4<f32>>;

var<immediate> params: SourceParams;

// Texels of the photo at a landing: top left, top right, and those under them.
fn texels(l: Landing) -> vec4<u32> {
    let below = l.texel + params.source_size.x;
    return vec4(photo[l.texel], photo[l.texel + 1u], photo[below], photo[below + 1u]);
}

// Sum of the weights of a pixel's median intersections that the source shows, `v` being the gradient by their colours.
fn read_weights(p: u32, ray: vec3<f32>, v: vec3<f32>) -> f32 {
    let pixels = params.size.x * params.size.y;
    var weights = SOURCE_EPSILON;
    for (var k = 0u; k < params.intersections; k++) {
        let intersection = intersections[k * pixels + p];
        let l = land(ray, intersection.x);
        if intersection.y > 0.0 && l.inside {
            weights += select(0.0, intersection.y, read_photo(l, v).valid);
        }
    }
    return weights;
}

// Sums of a thread. `turn`: offsets from the target's centre times the gradients by them, in the source's view space.
struct Sums {
    target_lens: CameraGradient,
    source: CameraGradient,
    turn: vec3<f32>,
}

// From the source's view space to the target's, as a direction.
fn back(v: vec3<f32>) -> vec3<f32> {
    return params.row0.xyz * v.x + params.row1.xyz * v.y + params.row2.xyz * v.z;
}

// Adds the gradients by the point at a depth on the target's ray, and by its offset from the target's centre.
fn add_point(sums: ptr<function, Sums>, pixel: vec2<u32>, offset: vec3<f32>, z: f32, v_point: vec3<f32>, v_offset: vec3<f32>) {
    let point = offset + vec3(params.row0.w, params.row1.w, params.row2.w);
    let v = v_point + v_offset;
    (*sums).source.translation += v_point;
    (*sums).source.rotation += cross(point, v_point) + cross(offset, v_offset);
    (*sums).turn += cross(offset, v);
    let ray = (vec2<f32>(pixel) - params.principal) / params.focal;
    var lens = (*sums).target_lens;
    add_ray(&lens, params.focal, ray, z * back(v).xy);
    (*sums).target_lens = lens;
}

// Gradient by v of the unit vector v / (|v| + epsilon).
fn unit_backward(v: vec3<f32>, by_unit: vec3<f32>) -> vec3<f32> {
    let size = length(v) + SOURCE_EPSILON;
    let unit = v / size;
    return (by_unit - unit * dot(unit, by_unit)) / size;
}

fn add_pixel(sums: ptr<function, Sums>, p: u32, m: u32) {
    let pixels = params.size.x * params.size.y;
    let pixel = vec2(p % params.size.x, p / params.size.x);
    let v = v_warped[m * pixels + p];
    let ray = source_ray(pixel);
    let weights = read_weights(p, ray, v.rgb);
    for (var k = 0u; k < params.intersections; k++) {
        let intersection = intersections[k * pixels + p];
        let l = land(ray, intersection.x);
        if intersection.y > 0.0 && l.inside {
            let read = read_photo(l, v.rgb);
            if read.valid {
                let v_at = read.slope * (intersection.y / weights);
                let point = source_point(ray, intersection.x);
                let ratio = point.xy / point.z;
                let v_ratio = params.source_focal * v_at / point.z;
                (*sums).source.focal += v_at * ratio;
                (*sums).source.principal += v_at;
                add_point(sums, pixel, ray * intersection.x, intersection.x, vec3(v_ratio, -dot(v_ratio, ratio)), vec3(0.0));
            }
        }
    }
    let z = median_depth[p];
    let offset = ray * z;
    let point = source_point(ray, z);
    let v_point = unit_backward(point, v.w * offset / (length(offset) + SOURCE_EPSILON));
    let v_offset = unit_backward(offset, v.w * point / (length(point) + SOURCE_EPSILON));
    add_point(sums, pixel, offset, z, v_point, v_offset);
}

@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    var sums: Sums;
    for (var p = wid.x * THREADS + local; p < params.size.x * params.size.y; p += CAMERA_GROUPS * THREADS) {
        // Which of the visible sources of this pixel this one is.
        var m = 0u;
        while m < params.visible && seen_source(seen[p], m) != params.index {
            m++;
        }
        if m < params.visible {
            add_pixel(&sums, p, m);
        }
    }
    var by_target = sums.target_lens;
    by_target.translation = -back(sums.source.translation);
    by_target.rotation = -back(sums.turn);
    store_camera(local, 6u * wid.x, by_target);
    store_camera(local, 6u * wid.x + 3u, sums.source);
}
