// Gradient of blend.wgsl, one workgroup a tile, back to front in chunks of CHUNK entries. First each thread is a pixel: it walks
// the chunk and leaves w, q and h for every entry. Then each thread is an (entry, lane) and sums what the gradients need over the
// pixels. Nothing is atomic: every intersection has a row of its own, written at its emission index, so that one Gaussian's rows lie
// side by side and are summed in a fixed order. Devices with subgroups of a fixed size have faster forms.
#if NARROW
#import blend_backward_narrow
#else
#import tile_order
#if SUBGROUPS
#import blend_backward_subgroups
#else
#import blend_backward_pixel

// Entries a chunk, and threads an entry in the second part.
const CHUNK: u32 = 8u;
const LANES: u32 = PIXELS / CHUNK;
#if INTERSECTIONS
// Numbers of an entry of the first part, gradients of a pixel and sums of the second part.
const NUMBERS: u32 = 3u;
const PIXEL: u32 = 6u;
const SUMS: u32 = 17u;
#else
const NUMBERS: u32 = 2u;
const PIXEL: u32 = 3u;
const SUMS: u32 = 11u;
#endif

// First part: w at [entry * 256 + pixel], q 2048 further, h 4096 further. Second part: partial sums at
// [sum * 256 + entry * 32 + lane].
var<workgroup> parts: array<f32, NUMBERS * CHUNK * PIXELS>;
// Gradients of the colour and of the normal map.
var<workgroup> pixel_v: array<f32, PIXEL * PIXELS>;
var<workgroup> entries: array<vec4<f32>, ENTRY * CHUNK>;

fn store_row(row: u32, color: vec4<f32>, xy: vec4<f32>, cov: vec4<f32>) {
    v_isect_color[row] = color;
    v_isect_xy[row] = xy;
    v_isect_cov[row] = cov;
}

fn sum_at(index: u32, entry: u32) -> f32 {
    return parts[SUMS * PIXELS + index * CHUNK + entry];
}

@compute @workgroup_size(PIXELS)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let tile = tile_of(wid);
    let origin = vec2<f32>(corner_of(tile));
    let start = tile_ranges[2u * tile];
    let length = tile_ranges[2u * tile + 1u] - start;
    var pixel = load_pixel(corner_of(tile) + vec2(local % TILE, local / TILE));
    pixel_v[local] = pixel.v.r;
    pixel_v[PIXELS + local] = pixel.v.g;
    pixel_v[2u * PIXELS + local] = pixel.v.b;
    #if INTERSECTIONS
    pixel_v[3u * PIXELS + local] = pixel.v_normal.x;
    pixel_v[4u * PIXELS + local] = pixel.v_normal.y;
    pixel_v[5u * PIXELS + local] = pixel.v_normal.z;
    #endif
    let walked = deepest_entry(local, pixel.last);

    // Entries that no pixel reached have rows too.
    for (var k = walked + local; k < length; k += PIXELS) {
        let row = sorted_isects[start + k];
        store_row(row, vec4(0.0), vec4(0.0), vec4(0.0));
        #if INTERSECTIONS
        v_isect_plane[row] = vec4(0.0);
        #endif
    }

    for (var c = (walked + CHUNK - 1u) / CHUNK; c > 0u; c--) {
        let first = (c - 1u) * CHUNK;
        if local < ENTRY * CHUNK {
            entries[local] = load_entry(local, first, start, length);
        }
        workgroupBarrier();
        for (var j = CHUNK; j > 0u; j--) {
            let e = j - 1u;
            let a = entries[ENTRY * e];
            let b = entries[ENTRY * e + 1u];
            let c = entries[ENTRY * e + 2u];
            #if INTERSECTIONS
            let visited = visit(&pixel, first + e, a, b, c, entries[ENTRY * e + 3u]);
            #else
            let visited = visit(&pixel, first + e, a, b, c);
            #endif
            parts[e * PIXELS + local] = visited.w;
            parts[(CHUNK + e) * PIXELS + local] = visited.q;
            #if INTERSECTIONS
            parts[(2u * CHUNK + e) * PIXELS + local] = visited.h;
            #endif
        }
        workgroupBarrier();

        let e = local / LANES;
        let a = entries[ENTRY * e];
        let b = entries[ENTRY * e + 1u];
        let k = b.x;
        // w, q and h are zero elsewhere.
        let rows = tile_rows(a.y - origin.y, vec3(a.zw, k), b.y) * TILE;
        var v_color = vec3(0.0);
        var v_log_opacity = 0.0;
        var v_xy = vec2(0.0);
        var v_abs = vec2(0.0);
        var v_cov = vec3(0.0);
        #if INTERSECTIONS
        var v_facing = vec3(0.0);
        var v_ray = vec3(0.0);
        #endif
        for (var i = rows.x + local % LANES; i < rows.y; i += LANES) {
            let w = parts[e * PIXELS + i];
            let q = parts[(CHUNK + e) * PIXELS + i];
            v_color += w * vec3(pixel_v[i], pixel_v[PIXELS + i], pixel_v[2u * PIXELS + i]);
            let there = origin + vec2(f32(i % TILE), f32(i / TILE));
            #if INTERSECTIONS
            let h = parts[(2u * CHUNK + e) * PIXELS + i];
            v_facing += w * vec3(pixel_v[3u * PIXELS + i], pixel_v[4u * PIXELS + i], pixel_v[5u * PIXELS + i]);
            v_ray += h * pixel_ray(there);
            #endif
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
        parts[local] = v_color.r;
        parts[PIXELS + local] = v_color.g;
        parts[2u * PIXELS + local] = v_color.b;
        parts[3u * PIXELS + local] = v_log_opacity;
        parts[4u * PIXELS + local] = v_xy.x;
        parts[5u * PIXELS + local] = v_xy.y;
        parts[6u * PIXELS + local] = v_abs.x;
        parts[7u * PIXELS + local] = v_abs.y;
        parts[8u * PIXELS + local] = v_cov.x;
        parts[9u * PIXELS + local] = v_cov.y;
        parts[10u * PIXELS + local] = v_cov.z;
        #if INTERSECTIONS
        parts[11u * PIXELS + local] = v_facing.x;
        parts[12u * PIXELS + local] = v_facing.y;
        parts[13u * PIXELS + local] = v_facing.z;
        parts[14u * PIXELS + local] = v_ray.x;
        parts[15u * PIXELS + local] = v_ray.y;
        parts[16u * PIXELS + local] = v_ray.z;
        #endif
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
            let row = sorted_isects[start + first + local];
            // q is taken by the logarithm of alpha; dL/d(opacity) = q / opacity.
            let opacity = entries[ENTRY * local + 1u].y;
            store_row(
                row,
                vec4(sum_at(0u, local), sum_at(1u, local), sum_at(2u, local), sum_at(3u, local) / opacity),
                vec4(sum_at(4u, local), sum_at(5u, local), sum_at(6u, local), sum_at(7u, local)),
                vec4(sum_at(8u, local), sum_at(9u, local), sum_at(10u, local), 0.0),
            );
            #if INTERSECTIONS
            let plane = entries[ENTRY * local + 3u];
            let ray = vec3(sum_at(14u, local), sum_at(15u, local), sum_at(16u, local));
            let facing = vec3(sum_at(11u, local), sum_at(12u, local), sum_at(13u, local));
            // dz/dD = z / D, and h (n_c . r + 1e-8) = z dL/dz.
            var v_distance = 0.0;
            if plane.w > 0.0 {
                v_distance = (dot(plane.xyz, ray) + SURFACE_EPSILON * ray.z) / plane.w;
            }
            v_isect_plane[row] = vec4(facing - ray, v_distance);
            #endif
        }
        workgroupBarrier();
    }
}
#endif
#endif
