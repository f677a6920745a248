// As rasterize_backward.wgsl, with the gradients of the normal map, the median depth and the median intersections. Where a
// pixel's list entry is one of its K intersections, a third number joins w and q: h = -dL/dz z^2 / D, by which the ray
// times the pixel adds to the plane's normal. Departs from the published code (method.md 10.2): the weights of the
// intersections know the transmittance in front of them.
#import surface
#import tile

@group(0) @binding(0) var<storage, read> projected: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> planes: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> sorted_gaussians: array<u32>;
@group(0) @binding(3) var<storage, read> sorted_isects: array<u32>;
@group(0) @binding(4) var<storage, read> tile_ranges: array<u32>;
@group(0) @binding(5) var<storage, read> final_t: array<f32>;
@group(0) @binding(6) var<storage, read> last_entry: array<u32>;
@group(0) @binding(7) var<storage, read> median_depth: array<f32>;
@group(0) @binding(8) var<storage, read> slots: array<vec2<f32>>;
@group(0) @binding(9) var<storage, read> slot_entries: array<u32>;
@group(0) @binding(10) var<storage, read> v_image: array<f32>;
@group(0) @binding(11) var<storage, read> v_normal_map: array<f32>;
@group(0) @binding(12) var<storage, read> v_median_depth: array<f32>;
@group(0) @binding(13) var<storage, read> v_slots: array<vec2<f32>>;
// Rows: (r, g, b, opacity), (x, y, |x|, |y|), (xx, xy, yy of the covariance, 0), (n_c, D_c).
@group(0) @binding(14) var<storage, read_write> v_isect_color: array<vec4<f32>>;
@group(0) @binding(15) var<storage, read_write> v_isect_xy: array<vec4<f32>>;
@group(0) @binding(16) var<storage, read_write> v_isect_cov: array<vec4<f32>>;
@group(0) @binding(17) var<storage, read_write> v_isect_plane: array<vec4<f32>>;

const PIXELS: u32 = TILE * TILE;
// Entries a chunk, and threads an entry in the second part.
const CHUNK: u32 = 8u;
const LANES: u32 = PIXELS / CHUNK;
const SUMS: u32 = 17u;

// First part: w at [entry * 256 + pixel], q 2048 further, h 4096 further. Second part: partial sums at
// [sum * 256 + entry * 32 + lane].
var<workgroup> parts: array<f32, 3u * CHUNK * PIXELS>;
// Gradients of colour and normal map.
var<workgroup> pixel_v: array<f32, 6u * PIXELS>;
var<workgroup> entries: array<vec4<f32>, 4u * CHUNK>;
var<workgroup> deepest: atomic<u32>;
var<workgroup> deepest_now: u32;

fn store_row(row: u32, color: vec4<f32>, xy: vec4<f32>, cov: vec4<f32>, plane: vec4<f32>) {
    v_isect_color[row] = color;
    v_isect_xy[row] = xy;
    v_isect_cov[row] = cov;
    v_isect_plane[row] = plane;
}

fn sum_at(index: u32, entry: u32) -> f32 {
    return parts[SUMS * PIXELS + index * CHUNK + entry];
}

@compute @workgroup_size(TILE, TILE)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(local_invocation_id) lid: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let pixel = wid.xy * TILE + lid.xy;
    let origin = vec2<f32>(wid.xy * TILE);
    let at = vec2<f32>(pixel);
    let tile = wid.y * frame.tiles.x + wid.x;
    let start = tile_ranges[2u * tile];
    let length = tile_ranges[2u * tile + 1u] - start;
    let plane_size = frame.size.x * frame.size.y;
    let p = pixel.y * frame.size.x + pixel.x;

    var t = 1.0;
    var last = 0u;
    var v = vec3(0.0);
    var v_normal = vec3(0.0);
    var median = 0.0;
    // dL/d(median depth) over the sum of the weights.
    var v_median = 0.0;
    // Slots from here on are done; `next` is the entry of the one before.
    var cursor = 0u;
    var next = NO_ENTRY;
    if all(pixel < frame.size) {
        t = final_t[p];
        last = last_entry[p];
        v = vec3(v_image[3u * p], v_image[3u * p + 1u], v_image[3u * p + 2u]);
        v_normal = vec3(v_normal_map[3u * p], v_normal_map[3u * p + 1u], v_normal_map[3u * p + 2u]);
        median = median_depth[p];
        var weights = SURFACE_EPSILON;
        for (var k = 0u; k < frame.slots; k++) {
            weights += slots[k * plane_size + p].y;
        }
        v_median = v_median_depth[p] / weights;
        cursor = frame.slots;
        while cursor > 0u && next == NO_ENTRY {
            cursor--;
            next = slot_entries[cursor * plane_size + p];
        }
    }
    // dL/d(weight) times the weights behind the current entry, and the background.
    var behind = t * dot(frame.background, v);
    for (var c = 0u; c < 3u; c++) {
        pixel_v[c * PIXELS + local] = v[c];
        pixel_v[(3u + c) * PIXELS + local] = v_normal[c];
    }
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
        store_row(sorted_isects[start + k], vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0));
    }

    for (var c = (walked + CHUNK - 1u) / CHUNK; c > 0u; c--) {
        let first = (c - 1u) * CHUNK;
        if local < 4u * CHUNK {
            let g = sorted_gaussians[start + min(first + local / 4u, length - 1u)];
            if local % 4u == 3u {
                entries[local] = planes[g];
            } else {
                entries[local] = projected[3u * g + local % 4u];
            }
        }
        workgroupBarrier();
        for (var j = CHUNK; j > 0u; j--) {
            let e = j - 1u;
            var w = 0.0;
            var q = 0.0;
            var h = 0.0;
            if first + e < last {
                let a = entries[4u * e];
                let b = entries[4u * e + 1u];
                let raw = b.y * exp(-falloff(a.xy - at, vec3(a.zw, b.x)));
                let alpha = min(ALPHA_MAX, raw);
                if alpha >= ALPHA_MIN {
                    let pass_through = 1.0 - alpha;
                    t = t / pass_through;
                    w = alpha * t;
                    let plane = entries[4u * e + 3u];
                    var v_weight = dot(entries[4u * e + 2u].rgb, v) + dot(plane.xyz, v_normal);
                    if next == first + e {
                        let slot = slots[cursor * plane_size + p];
                        let v_slot = v_slots[cursor * plane_size + p];
                        v_weight += v_slot.y + v_median * (slot.x - median);
                        h = -(v_slot.x + v_median * slot.y) * slot.x * slot.x / plane.w;
                        next = NO_ENTRY;
                        while cursor > 0u && next == NO_ENTRY {
                            cursor--;
                            next = slot_entries[cursor * plane_size + p];
                        }
                    }
                    if raw <= ALPHA_MAX {
                        q = alpha * (t * v_weight - behind / pass_through);
                    }
                    behind += w * v_weight;
                }
            }
            parts[e * PIXELS + local] = w;
            parts[(CHUNK + e) * PIXELS + local] = q;
            parts[(2u * CHUNK + e) * PIXELS + local] = h;
        }
        workgroupBarrier();

        let e = local / LANES;
        let a = entries[4u * e];
        let b = entries[4u * e + 1u];
        let k = b.x;
        // w, q and h are zero elsewhere.
        let rows = tile_rows(a.y - origin.y, vec3(a.zw, k), b.y) * TILE;
        var v_color = vec3(0.0);
        var v_log_opacity = 0.0;
        var v_xy = vec2(0.0);
        var v_abs = vec2(0.0);
        var v_cov = vec3(0.0);
        var v_facing = vec3(0.0);
        var v_ray = vec3(0.0);
        for (var i = rows.x + local % LANES; i < rows.y; i += LANES) {
            let w = parts[e * PIXELS + i];
            let q = parts[(CHUNK + e) * PIXELS + i];
            let h = parts[(2u * CHUNK + e) * PIXELS + i];
            v_color += w * vec3(pixel_v[i], pixel_v[PIXELS + i], pixel_v[2u * PIXELS + i]);
            v_facing += w * vec3(pixel_v[3u * PIXELS + i], pixel_v[4u * PIXELS + i], pixel_v[5u * PIXELS + i]);
            let there = origin + vec2(f32(i % TILE), f32(i / TILE));
            v_ray += h * pixel_ray(there);
            let d = a.xy - there;
            // g = conic d, so that d(-falloff)/d(xy) = -g and d(-falloff)/d(cov) = g g^T / 2.
            let gy = (d.y - a.w * d.x) * k;
            let g = vec2(d.x * a.z - a.w * gy, gy);
            v_log_opacity += q;
            v_xy -= q * g;
            v_abs += abs(q * g);
            v_cov += 0.5 * q * vec3(g.x * g.x, 2.0 * g.x * g.y, g.y * g.y);
        }
        workgroupBarrier();
        for (var i = 0u; i < 3u; i++) {
            parts[i * PIXELS + local] = v_color[i];
            parts[(8u + i) * PIXELS + local] = v_cov[i];
            parts[(11u + i) * PIXELS + local] = v_facing[i];
            parts[(14u + i) * PIXELS + local] = v_ray[i];
        }
        parts[3u * PIXELS + local] = v_log_opacity;
        parts[4u * PIXELS + local] = v_xy.x;
        parts[5u * PIXELS + local] = v_xy.y;
        parts[6u * PIXELS + local] = v_abs.x;
        parts[7u * PIXELS + local] = v_abs.y;
        workgroupBarrier();
        if local < CHUNK * SUMS {
            let base = (local / CHUNK) * PIXELS + (local % CHUNK) * LANES;
            var sum = 0.0;
            for (var i = 0u; i < LANES; i++) {
                // Rotated so that neighbouring threads read different banks.
                sum += parts[base + ((i + local) % LANES)];
            }
            parts[SUMS * PIXELS + local] = sum;
        }
        workgroupBarrier();
        if local < CHUNK && first + local < walked {
            // q is taken by the logarithm of alpha; dL/d(opacity) = q / opacity.
            let opacity = entries[4u * local + 1u].y;
            let plane = entries[4u * local + 3u];
            let ray = vec3(sum_at(14u, local), sum_at(15u, local), sum_at(16u, local));
            let facing = vec3(sum_at(11u, local), sum_at(12u, local), sum_at(13u, local));
            // dz/dD = z / D, and h (n_c . r + 1e-8) = z dL/dz.
            var v_distance = 0.0;
            if plane.w > 0.0 {
                v_distance = (dot(plane.xyz, ray) + SURFACE_EPSILON * ray.z) / plane.w;
            }
            store_row(
                sorted_isects[start + first + local],
                vec4(sum_at(0u, local), sum_at(1u, local), sum_at(2u, local), sum_at(3u, local) / opacity),
                vec4(sum_at(4u, local), sum_at(5u, local), sum_at(6u, local), sum_at(7u, local)),
                vec4(sum_at(8u, local), sum_at(9u, local), sum_at(10u, local), 0.0),
                vec4(facing - ray, v_distance),
            );
        }
        workgroupBarrier();
    }
}
