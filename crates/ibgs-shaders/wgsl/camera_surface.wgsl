//! Gradient of the median intersections by the lens.
#set train
#stage blend backward
// A fixed number of workgroups, each over its share of the pixels: what the rays that meet the planes say of the lens.
#import surface
#import camera_sums

@group(0) @binding(0) var<storage, read> planes: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> sorted_gaussians: array<u32>;
@group(0) @binding(2) var<storage, read> tile_ranges: array<u32>;
@group(0) @binding(3) var<storage, read> intersections: array<vec2<f32>>;
@group(0) @binding(4) var<storage, read> intersection_entries: array<u32>;
@group(0) @binding(5) var<storage, read> v_median_depth: array<f32>;
@group(0) @binding(6) var<storage, read> v_intersections: array<vec2<f32>>;
@group(0) @binding(7) var<storage, read_write> partials: array<vec4<f32>>;

@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    var sum: CameraGradient;
    let pixels = frame.size.x * frame.size.y;
    for (var p = wid.x * THREADS + local; p < pixels; p += CAMERA_GROUPS * THREADS) {
        var weights = SURFACE_EPSILON;
        for (var k = 0u; k < frame.intersections; k++) {
            weights += intersections[k * pixels + p].y;
        }
        let at = vec2(p % frame.size.x, p / frame.size.x);
        let start = tile_ranges[2u * (at.y / TILE * frame.tiles.x + at.x / TILE)];
        var v_ray = vec2(0.0);
        for (var k = 0u; k < frame.intersections; k++) {
            let entry = intersection_entries[k * pixels + p];
            if entry == NO_ENTRY {
                continue;
            }
            let plane = planes[sorted_gaussians[start + entry]];
            let intersection = intersections[k * pixels + p];
            let v_z = v_intersections[k * pixels + p].x + v_median_depth[p] / weights * intersection.y;
            // z = -D / (n . r), so that dz/dr = z^2 / D n.
            v_ray += v_z * intersection.x * intersection.x / plane.w * plane.xy;
        }
        add_ray(&sum, frame.focal, pixel_ray(vec2<f32>(at)).xy, v_ray);
    }
    store_camera(local, 3u * wid.x, sum);
}
