// Gradient of blend.wgsl, one workgroup a tile, back to front in chunks of entries. A subgroup walks only the entries that may
// reach its pixels and sums their gradients among its 16 or 32 lanes; then the workgroup sums over the subgroups. Nothing is atomic: every
// intersection has a row of its own, written at its emission index, so that one Gaussian's rows lie side by side and are summed in
// a fixed order.
#import block
#import subgroup_sums
#import blend_backward_pixel

const SUBGROUPS: u32 = PIXELS / LANES;
// Numbers that subgroup_sums gives.
const NUMBERS: u32 = 16u;
// Those of an intersection's row, four of each buffer, and entries of a chunk. The less workgroup memory, the more workgroups run at
// once.
#if INTERSECTIONS
const ROW: u32 = NUMBERS;
const CHUNK: u32 = 16u;
#else
const ROW: u32 = 12u;
const CHUNK: u32 = LANES;
#endif

// [subgroup][entry][number].
var<workgroup> parts: array<f32, SUBGROUPS * CHUNK * ROW>;
// Entries that each subgroup has summed, as bits.
var<workgroup> summed: array<u32, SUBGROUPS>;
// Of one chunk and of the next.
var<workgroup> entries: array<vec4<f32>, 2u * ENTRY * CHUNK>;

fn store(row: u32, number: u32, value: f32) {
    let at = number % 4u;
    switch number / 4u {
        case 0u: {
            v_isect_color[row][at] = value;
        }
        case 1u: {
            v_isect_xy[row][at] = value;
        }
        #if INTERSECTIONS
        case 3u: {
            v_isect_plane[row][at] = value;
        }
        #endif
        case 2u: {
            v_isect_cov[row][at] = value;
        }
        default: {}
    }
}

// What an entry's sum is multiplied by. q is taken by the logarithm of alpha: dL/d(opacity) = q / opacity. By the plane's distance D,
// dz/dD = z / D.
fn factor(entry: u32, number: u32) -> f32 {
    if number == 3u {
        return 1.0 / entries[entry + 1u].y;
    }
    #if INTERSECTIONS
    if number == ROW - 1u {
        let distance = entries[entry + 3u].w;
        return select(0.0, 1.0 / distance, distance > 0.0);
    }
    #endif
    return 1.0;
}

@compute @workgroup_size(PIXELS)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
    @builtin(subgroup_id) subgroup: u32,
    @builtin(subgroup_invocation_id) lane: u32,
) {
    let tile = tile_of(wid);
    let start = tile_ranges[2u * tile];
    let length = tile_ranges[2u * tile + 1u] - start;
    let block = vec2<f32>(corner_of(tile) + block_pixel(subgroup, 0u));
    var pixel = load_pixel(corner_of(tile) + block_pixel(subgroup, lane));
    #if INTERSECTIONS
    let ray = pixel_ray(pixel.at);
    #endif
    let walked = deepest_entry(local, pixel.last);
    let own_walked = subgroupMax(pixel.last);

    // Entries that no pixel reached have rows too.
    for (var k = walked + local / ROW; k < length; k += PIXELS / ROW) {
        store(sorted_isects[start + k], local % ROW, 0.0);
    }

    let chunks = (walked + CHUNK - 1u) / CHUNK;
    if local < ENTRY * CHUNK && chunks > 0u {
        entries[ENTRY * CHUNK * (chunks % 2u) + local] = load_entry(local, (chunks - 1u) * CHUNK, start, length);
    }
    for (var c = chunks; c > 0u; c--) {
        let first = (c - 1u) * CHUNK;
        let now = ENTRY * CHUNK * (c % 2u);
        workgroupBarrier();
        var ahead = vec4(0.0);
        let loads_ahead = c > 1u && local < ENTRY * CHUNK;
        if loads_ahead {
            ahead = load_entry(local, first - CHUNK, start, length);
        }
        let own_a = entries[now + ENTRY * (lane % CHUNK)];
        let own_b = entries[now + ENTRY * (lane % CHUNK) + 1u];
        let reaches = lane < CHUNK && first + lane < own_walked && reaches_block(block - own_a.xy, vec3(own_a.zw, own_b.x), own_b.y);
        let reaching = subgroupBallot(reaches).x;
        var left = reaching;
        while left != 0u {
            let e = firstLeadingBit(left);
            left ^= 1u << e;
            let a = entries[now + ENTRY * e];
            let b = entries[now + ENTRY * e + 1u];
            let color = entries[now + ENTRY * e + 2u];
            #if INTERSECTIONS
            let plane = entries[now + ENTRY * e + 3u];
            let visited = visit(&pixel, first + e, a, b, color, plane);
            #else
            let visited = visit(&pixel, first + e, a, b, color);
            #endif
            let q = visited.q;
            let d = a.xy - pixel.at;
            // g = conic d, so that d(-falloff)/d(xy) = -g and d(-falloff)/d(cov) = g g^T / 2.
            let gy = (d.y - a.w * d.x) * b.x;
            let g = vec2(d.x * a.z - a.w * gy, gy);
            let v_xy = -q * g;
            #if INTERSECTIONS
            // h (n_c . r + 1e-8) = z dL/dz.
            let v_plane = vec4(
                visited.w * pixel.v_normal - visited.h * ray,
                visited.h * (dot(plane.xyz, ray) + SURFACE_EPSILON),
            );
            #else
            let v_plane = vec4(0.0);
            #endif
            let sum = subgroup_sums(
                lane,
                vec4(visited.w * pixel.v, q),
                vec4(v_xy, abs(v_xy)),
                vec4(0.5 * q * vec3(g.x * g.x, 2.0 * g.x * g.y, g.y * g.y), 0.0),
                v_plane,
            );
            let number = lane * NUMBERS / LANES;
            if lane % (LANES / NUMBERS) == 0u && number < ROW {
                parts[(subgroup * CHUNK + e) * ROW + number] = sum;
            }
        }
        if lane == 0u {
            summed[subgroup] = reaching;
        }
        if loads_ahead {
            entries[ENTRY * CHUNK - now + local] = ahead;
        }
        workgroupBarrier();
        for (var i = local; i < min(walked - first, CHUNK) * ROW; i += PIXELS) {
            let e = i / ROW;
            var sum = 0.0;
            for (var s = 0u; s < SUBGROUPS; s++) {
                if (summed[s] & (1u << e)) != 0u {
                    sum += parts[s * CHUNK * ROW + i];
                }
            }
            store(sorted_isects[start + first + e], i % ROW, sum * factor(now + ENTRY * e, i % ROW));
        }
    }
}
