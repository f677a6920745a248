#set train
#import depth_normal
#import photo

#kernel normal_loss
//! Depth normals against the normal map, forward.
#stage normal loss
// One workgroup a tile: sum of 0.4 sum_c |Nd - N| + 0.6 (1 - Nd . N), and the number of pixels (method.md section 7).
// Pixels that are masked in the photo add nothing to the sum.
#import reduce

@group(0) @binding(0) var<storage, read> depth: array<f32>;
@group(0) @binding(1) var<storage, read> normal: array<f32>;
@group(0) @binding(2) var<storage, read> photo: array<u32>;
@group(0) @binding(3) var<storage, read_write> partials: array<vec2<f32>>;

const THREADS: u32 = TILE * TILE;

@compute @workgroup_size(TILE, TILE)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_id) lid: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let at = wid.xy * TILE + lid.xy;
    var value = vec4(0.0);
    if all(at < params.size) {
        let p = at.y * params.size.x + at.x;
        value.y = 1.0;
        if photo_valid(photo[p]) {
            let nd = depth_normal(at).normal;
            let n = vec3(normal[3u * p], normal[3u * p + 1u], normal[3u * p + 2u]);
            let difference = dot(abs(nd - n), vec3(1.0));
            value.x = NORMAL_L1 * difference + NORMAL_DOT * (1.0 - dot(nd, n));
        }
    }
    let total = reduce(local, value);
    if local == 0u {
        partials[wid.y * groups.x + wid.x] = total.xy;
    }
}

#kernel normal_loss_backward
//! Depth normals against the normal map, gradients by median depth and normal map.
#stage normal loss backward
#import normal_gradient
// One workgroup a tile: adds the gradients of the normal loss by median depth and normal map, times the upstream
// scalar. Pixels that are masked in the photo have no part in it. A pixel's depth enters the depth normals of its four neighbours: it gathers from them.

@group(0) @binding(0) var<storage, read> depth: array<f32>;
@group(0) @binding(1) var<storage, read> normal: array<f32>;
@group(0) @binding(2) var<storage, read> photo: array<u32>;
@group(0) @binding(3) var<storage, read> v_loss: array<f32>;
@group(0) @binding(4) var<storage, read_write> v_depth: array<f32>;
@group(0) @binding(5) var<storage, read_write> v_normal: array<f32>;

// A tile with one pixel around it.
const EDGE: u32 = TILE + 2u;
// 2 v_p / (z_r + z_l)^2 and 2 v_q / (z_t + z_b)^2 of each pixel, see shared/depth_normal.wgsl.
var<workgroup> slopes: array<vec2<f32>, EDGE * EDGE>;

fn slope_gradient(at: vec2<u32>) -> vec2<f32> {
    let nd = depth_normal(at);
    let v_m = cross_gradient(at, nd);
    if nd.inverse == 0.0 {
        return vec2(0.0);
    }
    let offset = vec2<f32>(at) - params.principal;
    let v_p = params.focal.x * v_m.x - offset.x * v_m.z;
    let v_q = offset.y * v_m.z - params.focal.y * v_m.y;
    return 2.0 * vec2(v_p, v_q) / (nd.sums * nd.sums);
}

// Depth at an offset from a pixel. Outside the image, where no neighbour has a normal, its factor is 0.
fn depth_at(at: vec2<i32>) -> f32 {
    if any(at < vec2(0)) || any(at >= vec2<i32>(params.size)) {
        return 0.0;
    }
    return depth[u32(at.y) * params.size.x + u32(at.x)];
}

@compute @workgroup_size(TILE, TILE)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(local_invocation_id) lid: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    for (var k = local; k < EDGE * EDGE; k += TILE * TILE) {
        let at = vec2<i32>(wid.xy * TILE + vec2(k % EDGE, k / EDGE)) - 1;
        var value = vec2(0.0);
        if all(at >= vec2(0)) && all(at < vec2<i32>(params.size)) {
            value = slope_gradient(vec2<u32>(at));
        }
        slopes[k] = value;
    }
    workgroupBarrier();
    let pixel = wid.xy * TILE + lid.xy;
    if any(pixel >= params.size) {
        return;
    }
    let p = pixel.y * params.size.x + pixel.x;
    let at = vec2<i32>(pixel);
    let k = (lid.y + 1u) * EDGE + lid.x + 1u;
    // It is the right neighbour of k - 1, the left one of k + 1, the upper one of the row below, the lower one of the
    // row above.
    v_depth[p] += slopes[k - 1u].x * depth_at(at - vec2(2, 0)) - slopes[k + 1u].x * depth_at(at + vec2(2, 0))
        + slopes[k + EDGE].y * depth_at(at + vec2(0, 2)) - slopes[k - EDGE].y * depth_at(at - vec2(0, 2));
    if !photo_valid(photo[p]) {
        return;
    }
    let nd = depth_normal(pixel).normal;
    let v_n = -scale() * (NORMAL_L1 * sign(nd - normal_at(pixel)) + NORMAL_DOT * nd);
    v_normal[3u * p] += v_n.x;
    v_normal[3u * p + 1u] += v_n.y;
    v_normal[3u * p + 2u] += v_n.z;
}

#kernel normal_loss_camera
//! Depth normals against the normal map, gradient by the lens.
#stage normal loss backward
// A fixed number of workgroups, each over its share of the pixels.
#import normal_gradient
#import camera_sums

@group(0) @binding(0) var<storage, read> depth: array<f32>;
@group(0) @binding(1) var<storage, read> normal: array<f32>;
@group(0) @binding(2) var<storage, read> photo: array<u32>;
@group(0) @binding(3) var<storage, read> v_loss: array<f32>;
@group(0) @binding(4) var<storage, read_write> partials: array<vec4<f32>>;

@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    var sum: CameraGradient;
    for (var p = wid.x * THREADS + local; p < params.size.x * params.size.y; p += CAMERA_GROUPS * THREADS) {
        let at = vec2(p % params.size.x, p / params.size.x);
        let nd = depth_normal(at);
        if nd.inverse == 0.0 {
            continue;
        }
        let v_m = cross_gradient(at, nd);
        // m is linear in the lens.
        let slope = nd.normal.xy / (nd.inverse * params.focal);
        sum.focal += v_m.xy * slope;
        sum.principal += v_m.z * slope;
    }
    store_camera(local, 3u * wid.x, sum);
}
