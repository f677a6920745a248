// One workgroup a tile, back to front in chunks of CHUNK entries. First each thread is a pixel: it walks the chunk and
// leaves two numbers for every entry, w = alpha T and q = dL/d(falloff) negated. Then each thread is an (entry, lane)
// and sums what the gradients need over the pixels. Nothing is atomic: every intersection has a row of its own, written
// at its emission index, so that one Gaussian's rows lie side by side and are summed in a fixed order.
#import frame
#import tile

@group(0) @binding(0) var<storage, read> projected: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> sorted_gaussians: array<u32>;
@group(0) @binding(2) var<storage, read> sorted_isects: array<u32>;
@group(0) @binding(3) var<storage, read> tile_ranges: array<u32>;
@group(0) @binding(4) var<storage, read> final_t: array<f32>;
@group(0) @binding(5) var<storage, read> last_entry: array<u32>;
@group(0) @binding(6) var<storage, read> v_image: array<f32>;
// Rows: (r, g, b, opacity), (x, y, |x|, |y|), (xx, xy, yy of the covariance, 0).
@group(0) @binding(7) var<storage, read_write> v_isect_color: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> v_isect_xy: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read_write> v_isect_cov: array<vec4<f32>>;

const PIXELS: u32 = TILE * TILE;
// Entries a chunk, and threads an entry in the second part.
const CHUNK: u32 = 8u;
const LANES: u32 = PIXELS / CHUNK;
const SUMS: u32 = 11u;

// First part: w at [entry * 256 + pixel], q 2048 further. Second part: partial sums at [sum * 256 + entry * 32 + lane].
var<workgroup> pairs: array<f32, 2u * CHUNK * PIXELS>;
var<workgroup> pixel_v: array<f32, 3u * PIXELS>;
var<workgroup> entries: array<vec4<f32>, 3u * CHUNK>;
var<workgroup> deepest: atomic<u32>;
var<workgroup> deepest_now: u32;

@compute @workgroup_size(TILE, TILE)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(local_invocation_id) lid: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let pixel = wid.xy * TILE + lid.xy;
    let origin = vec2<f32>(wid.xy * TILE);
    let at = vec2<f32>(pixel);
    let tile = wid.y * frame_tiles().x + wid.x;
    let start = tile_ranges[2u * tile];
    let length = tile_ranges[2u * tile + 1u] - start;

    var t = 1.0;
    var last = 0u;
    var v = vec3(0.0);
    if all(pixel < frame.size) {
        let p = pixel.y * frame.size.x + pixel.x;
        t = final_t[p];
        last = last_entry[p];
        v = vec3(v_image[3u * p], v_image[3u * p + 1u], v_image[3u * p + 2u]);
    }
    // dL/d(image) times the colour that lies behind the current entry.
    var behind = t * dot(frame.background, v);
    pixel_v[local] = v.r;
    pixel_v[PIXELS + local] = v.g;
    pixel_v[2u * PIXELS + local] = v.b;
    if local == 0u {
        atomicStore(&deepest, 0u);
    }
    workgroupBarrier();
    atomicMax(&deepest, last);
    workgroupBarrier();
    if local == 0u {
        deepest_now = atomicLoad(&deepest);
    }
    let walked = workgroupUniformLoad(&deepest_now);

    // Entries that no pixel reached have rows too.
    for (var k = walked + local; k < length; k += PIXELS) {
        let row = sorted_isects[start + k];
        v_isect_color[row] = vec4(0.0);
        v_isect_xy[row] = vec4(0.0);
        v_isect_cov[row] = vec4(0.0);
    }

    for (var c = (walked + CHUNK - 1u) / CHUNK; c > 0u; c--) {
        let first = (c - 1u) * CHUNK;
        if local < 3u * CHUNK {
            let k = min(first + local / 3u, length - 1u);
            entries[local] = projected[3u * sorted_gaussians[start + k] + local % 3u];
        }
        workgroupBarrier();
        for (var j = CHUNK; j > 0u; j--) {
            let e = j - 1u;
            var w = 0.0;
            var q = 0.0;
            if first + e < last {
                let a = entries[3u * e];
                let b = entries[3u * e + 1u];
                let raw = b.y * exp(-falloff(a.xy - at, vec3(a.zw, b.x)));
                let alpha = min(ALPHA_MAX, raw);
                if alpha >= ALPHA_MIN {
                    let pass_through = 1.0 - alpha;
                    t = t / pass_through;
                    let shade = dot(entries[3u * e + 2u].rgb, v);
                    w = alpha * t;
                    if raw <= ALPHA_MAX {
                        q = alpha * (t * shade - behind / pass_through);
                    }
                    behind += w * shade;
                }
            }
            pairs[e * PIXELS + local] = w;
            pairs[(CHUNK + e) * PIXELS + local] = q;
        }
        workgroupBarrier();

        let e = local / LANES;
        let lane = local % LANES;
        let a = entries[3u * e];
        let b = entries[3u * e + 1u];
        let k = b.x;
        // w and q are zero elsewhere.
        let rows = tile_rows(a.y - origin.y, vec3(a.zw, k), b.y) * TILE;
        var v_color = vec3(0.0);
        var v_log_opacity = 0.0;
        var v_xy = vec2(0.0);
        var v_abs = vec2(0.0);
        var v_cov = vec3(0.0);
        for (var i = rows.x + lane; i < rows.y; i += LANES) {
            let w = pairs[e * PIXELS + i];
            let q = pairs[(CHUNK + e) * PIXELS + i];
            v_color += w * vec3(pixel_v[i], pixel_v[PIXELS + i], pixel_v[2u * PIXELS + i]);
            let d = a.xy - origin - vec2(f32(i % TILE), f32(i / TILE));
            // g = conic d, so that d(-falloff)/d(xy) = -g and d(-falloff)/d(cov) = g g^T / 2.
            let gy = (d.y - a.w * d.x) * k;
            let g = vec2(d.x * a.z - a.w * gy, gy);
            v_log_opacity += q;
            v_xy -= q * g;
            v_abs += abs(q * g);
            v_cov += 0.5 * q * vec3(g.x * g.x, 2.0 * g.x * g.y, g.y * g.y);
        }
        workgroupBarrier();
        pairs[local] = v_color.r;
        pairs[PIXELS + local] = v_color.g;
        pairs[2u * PIXELS + local] = v_color.b;
        pairs[3u * PIXELS + local] = v_log_opacity;
        pairs[4u * PIXELS + local] = v_xy.x;
        pairs[5u * PIXELS + local] = v_xy.y;
        pairs[6u * PIXELS + local] = v_abs.x;
        pairs[7u * PIXELS + local] = v_abs.y;
        pairs[8u * PIXELS + local] = v_cov.x;
        pairs[9u * PIXELS + local] = v_cov.y;
        pairs[10u * PIXELS + local] = v_cov.z;
        workgroupBarrier();
        if local < CHUNK * SUMS {
            let base = (local / CHUNK) * PIXELS + (local % CHUNK) * LANES;
            var sum = 0.0;
            for (var i = 0u; i < LANES; i++) {
                // Rotated so that neighbouring threads read different banks.
                sum += pairs[base + ((i + local) % LANES)];
            }
            pairs[SUMS * PIXELS + local] = sum;
        }
        workgroupBarrier();
        if local < CHUNK && first + local < walked {
            let row = sorted_isects[start + first + local];
            let s = SUMS * PIXELS + local;
            // q is taken by the logarithm of alpha; dL/d(opacity) = q / opacity.
            let opacity = entries[3u * local + 1u].y;
            v_isect_color[row] = vec4(pairs[s], pairs[s + CHUNK], pairs[s + 2u * CHUNK], pairs[s + 3u * CHUNK] / opacity);
            v_isect_xy[row] = vec4(pairs[s + 4u * CHUNK], pairs[s + 5u * CHUNK], pairs[s + 6u * CHUNK], pairs[s + 7u * CHUNK]);
            v_isect_cov[row] = vec4(pairs[s + 8u * CHUNK], pairs[s + 9u * CHUNK], pairs[s + 10u * CHUNK], 0.0);
        }
        workgroupBarrier();
    }
}
