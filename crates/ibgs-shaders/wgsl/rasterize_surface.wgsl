// One workgroup a tile, one thread a pixel: alpha blending as in rasterize.wgsl, and beside the colour the normal map, the
// K median intersections and the median depth (method.md section 3).
#import surface
#import tile

@group(0) @binding(0) var<storage, read> projected: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> planes: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> sorted_gaussians: array<u32>;
@group(0) @binding(3) var<storage, read> tile_ranges: array<u32>;
@group(0) @binding(4) var<storage, read_write> image: array<f32>;
@group(0) @binding(5) var<storage, read_write> final_t: array<f32>;
@group(0) @binding(6) var<storage, read_write> last_entry: array<u32>;
// Sum of w n_c, three values a pixel.
@group(0) @binding(7) var<storage, read_write> normal_map: array<f32>;
@group(0) @binding(8) var<storage, read_write> median_depth: array<f32>;
// K planes of (view depth, weight), front to back; weight 0 = empty.
@group(0) @binding(9) var<storage, read_write> slots: array<vec2<f32>>;
// Their entries in the tile's list.
@group(0) @binding(10) var<storage, read_write> slot_entries: array<u32>;

const BATCH: u32 = TILE * TILE;

var<workgroup> batch: array<vec4<f32>, 4u * BATCH>;
var<workgroup> finished: atomic<u32>;
var<workgroup> finished_now: u32;

@compute @workgroup_size(TILE, TILE)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(local_invocation_id) lid: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let pixel = wid.xy * TILE + lid.xy;
    let inside = all(pixel < frame.size);
    let at = vec2<f32>(pixel);
    let ray = pixel_ray(at);
    let half = frame.slots / 2u;
    let tile = wid.y * frame.tiles.x + wid.x;
    let start = tile_ranges[2u * tile];
    let end = tile_ranges[2u * tile + 1u];
    if local == 0u {
        atomicStore(&finished, 0u);
        finished_now = 0u;
    }
    workgroupBarrier();
    var t = 1.0;
    var color = vec3(0.0);
    var normal = vec3(0.0);
    // Shift registers, newest last: `before` keeps what came last, `after` closes when it holds K/2.
    var before_z = vec4(0.0);
    var before_w = vec4(0.0);
    var before_e = vec4(NO_ENTRY);
    var after_z = vec4(0.0);
    var after_w = vec4(0.0);
    var after_e = vec4(NO_ENTRY);
    var after_count = 0u;
    var last = 0u;
    var done = !inside;
    if done {
        atomicAdd(&finished, 1u);
    }
    for (var first = start; first < end; first += BATCH) {
        workgroupBarrier();
        if local == 0u {
            finished_now = atomicLoad(&finished);
        }
        if workgroupUniformLoad(&finished_now) == BATCH {
            break;
        }
        let k = first + local;
        if k < end {
            let g = sorted_gaussians[k];
            batch[4u * local] = projected[3u * g];
            batch[4u * local + 1u] = projected[3u * g + 1u];
            batch[4u * local + 2u] = projected[3u * g + 2u];
            batch[4u * local + 3u] = planes[g];
        }
        workgroupBarrier();
        if !done {
            let size = min(BATCH, end - first);
            for (var j = 0u; j < size; j++) {
                let a = batch[4u * j];
                let b = batch[4u * j + 1u];
                let alpha = min(ALPHA_MAX, b.y * exp(-falloff(a.xy - at, vec3(a.zw, b.x))));
                if alpha < ALPHA_MIN {
                    continue;
                }
                let after = t * (1.0 - alpha);
                if after < T_MIN {
                    done = true;
                    atomicAdd(&finished, 1u);
                    break;
                }
                let weight = alpha * t;
                let plane = batch[4u * j + 3u];
                let entry = first + j - start;
                color += weight * batch[4u * j + 2u].rgb;
                normal += weight * plane.xyz;
                let z = plane_depth(plane, ray);
                if z > 0.0 {
                    if t > MEDIAN_T {
                        before_z = vec4(before_z.yzw, z);
                        before_w = vec4(before_w.yzw, weight);
                        before_e = vec4(before_e.yzw, entry);
                    } else if after_count < half {
                        after_z = vec4(after_z.yzw, z);
                        after_w = vec4(after_w.yzw, weight);
                        after_e = vec4(after_e.yzw, entry);
                        after_count += 1u;
                    }
                }
                t = after;
                last = entry + 1u;
            }
        }
    }
    if inside {
        let p = pixel.y * frame.size.x + pixel.x;
        let out = color + t * frame.background;
        for (var c = 0u; c < 3u; c++) {
            image[3u * p + c] = out[c];
            normal_map[3u * p + c] = normal[c];
        }
        final_t[p] = t;
        last_entry[p] = last;
        let plane_size = frame.size.x * frame.size.y;
        // Copies: a register that is indexed by a variable would live in memory all along.
        let bz = before_z;
        let bw = before_w;
        let be = before_e;
        let az = after_z;
        let aw = after_w;
        let ae = after_e;
        var sum = 0.0;
        var weights = 0.0;
        for (var k = 0u; k < half; k++) {
            let c = 4u - half + k;
            slots[k * plane_size + p] = vec2(bz[c], bw[c]);
            slot_entries[k * plane_size + p] = be[c];
            slots[(half + k) * plane_size + p] = vec2(az[c], aw[c]);
            slot_entries[(half + k) * plane_size + p] = ae[c];
            sum += bz[c] * bw[c] + az[c] * aw[c];
            weights += bw[c] + aw[c];
        }
        median_depth[p] = sum / (weights + SURFACE_EPSILON);
    }
}
