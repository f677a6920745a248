// One workgroup a tile, one thread a pixel: front-to-back alpha blending with early stop (method.md section 2).
#import frame
#import tile

@group(0) @binding(0) var<storage, read> projected: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> sorted_gaussians: array<u32>;
@group(0) @binding(2) var<storage, read> tile_ranges: array<u32>;
@group(0) @binding(3) var<storage, read_write> image: array<f32>;
// Transmittance behind the last contributor, and how many list entries of the tile were walked up to it.
@group(0) @binding(4) var<storage, read_write> final_t: array<f32>;
@group(0) @binding(5) var<storage, read_write> last_entry: array<u32>;

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
    let tile = wid.y * frame_tiles().x + wid.x;
    let start = tile_ranges[2u * tile];
    let end = tile_ranges[2u * tile + 1u];
    if local == 0u {
        atomicStore(&finished, 0u);
        finished_now = 0u;
    }
    workgroupBarrier();
    var t = 1.0;
    var color = vec3(0.0);
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
            batch[3u * local] = projected[3u * g];
            batch[3u * local + 1u] = projected[3u * g + 1u];
            batch[3u * local + 2u] = projected[3u * g + 2u];
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
                if after < T_MIN {
                    done = true;
                    atomicAdd(&finished, 1u);
                    break;
                }
                color += (alpha * t) * batch[3u * j + 2u].rgb;
                t = after;
                last = first + j + 1u - start;
            }
        }
    }
    if inside {
        let p = pixel.y * frame.size.x + pixel.x;
        let out = color + t * frame.background;
        image[3u * p] = out.r;
        image[3u * p + 1u] = out.g;
        image[3u * p + 2u] = out.b;
        final_t[p] = t;
        last_entry[p] = last;
    }
}
