// One workgroup a tile, one thread a pixel: the median depth alone. A pixel stops as soon as its buffer `after` is full.
#import surface
#import tile

@group(0) @binding(0) var<storage, read> projected: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> planes: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> sorted_gaussians: array<u32>;
@group(0) @binding(3) var<storage, read> tile_ranges: array<u32>;
@group(0) @binding(4) var<storage, read_write> median_depth: array<f32>;

const BATCH: u32 = TILE * TILE;

var<workgroup> batch: array<vec4<f32>, 3u * BATCH>;
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
    var before_z = vec4(0.0);
    var before_w = vec4(0.0);
    var after_sum = 0.0;
    var after_weights = 0.0;
    var after_count = 0u;
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
            batch[3u * local] = projected[3u * g];
            batch[3u * local + 1u] = projected[3u * g + 1u];
            batch[3u * local + 2u] = planes[g];
        }
        workgroupBarrier();
        if !done {
            let size = min(BATCH, end - first);
            for (var j = 0u; j < size; j++) {
                let a = batch[3u * j];
                let b = batch[3u * j + 1u];
                let alpha = min(ALPHA_MAX, b.y * exp(-falloff(a.xy - at, vec3(a.zw, b.x))));
                if alpha < ALPHA_MIN {
                    continue;
                }
                let after = t * (1.0 - alpha);
                let weight = alpha * t;
                let z = plane_depth(batch[3u * j + 2u], ray);
                if z > 0.0 && after >= T_MIN {
                    if t > MEDIAN_T {
                        before_z = vec4(before_z.yzw, z);
                        before_w = vec4(before_w.yzw, weight);
                    } else {
                        after_sum += z * weight;
                        after_weights += weight;
                        after_count += 1u;
                    }
                }
                t = after;
                if after < T_MIN || after_count == half {
                    done = true;
                    atomicAdd(&finished, 1u);
                    break;
                }
            }
        }
    }
    if inside {
        let kept = select(vec4(0.0), before_w, vec4(0u, 1u, 2u, 3u) >= vec4(4u - half));
        let weights = dot(kept, vec4(1.0)) + after_weights;
        let p = pixel.y * frame.size.x + pixel.x;
        median_depth[p] = (dot(kept, before_z) + after_sum) / (weights + SURFACE_EPSILON);
    }
}
