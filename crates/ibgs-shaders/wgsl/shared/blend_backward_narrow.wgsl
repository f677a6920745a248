// Gradient of blend.wgsl for processors, one subgroup a tile, back to front in chunks of as many entries as it has lanes. A driver in
// software reads memory lane by lane, takes both sides of a branch, and exchanges lanes in one instruction. So each lane is an entry
// and walks the tile's pixels: its sums stay with it, without memory, and what passes from entry to entry within a pixel is a scan
// over the lanes. Between the chunks each lane keeps a pixel of every group of as many pixels. Nothing is atomic: every intersection
// has a row of its own, written at its emission index.
#import tile_order

const GROUPS: u32 = TILE * TILE / LANES;

// Of the pixels: transmittance and dL/d(weight) times weights behind the current entry, last entry that counted, gradient of the
// colour.
var<private> pixel_t: array<f32, GROUPS>;
var<private> pixel_behind: array<f32, GROUPS>;
var<private> pixel_last: array<u32, GROUPS>;
var<private> pixel_v: array<vec3<f32>, GROUPS>;
#if INTERSECTIONS
var<private> pixel_normal: array<vec3<f32>, GROUPS>;
// How many of a pixel's intersections are left. Row n of the next two is the n-th: its list entry, what it adds to dL/d(weight), and
// -dL/dz z^2.
var<private> pixel_left: array<u32, GROUPS>;
var<private> event_entry: array<u32, 9u * GROUPS>;
var<private> event: array<vec2<f32>, 9u * GROUPS>;
#endif

// x of the lane `back` behind, or `outside` where there is none.
fn from_behind(x: f32, lane: u32, back: u32, outside: f32) -> f32 {
    return select(outside, subgroupShuffle(x, (lane + back) % LANES), lane + back < LANES);
}

fn product_behind(x: f32, lane: u32) -> f32 {
    var product = x * from_behind(x, lane, 1u, 1.0);
    product *= from_behind(product, lane, 2u, 1.0);
    return product * from_behind(product, lane, 4u, 1.0);
}

fn sum_behind(x: f32, lane: u32) -> f32 {
    var sum = x + from_behind(x, lane, 1u, 0.0);
    sum += from_behind(sum, lane, 2u, 0.0);
    return sum + from_behind(sum, lane, 4u, 0.0);
}

fn most(x: u32, lane: u32) -> u32 {
    var most = max(x, subgroupShuffle(x, lane ^ 1u));
    most = max(most, subgroupShuffle(most, lane ^ 2u));
    return max(most, subgroupShuffle(most, lane ^ 4u));
}

fn pixel_of(group: u32, lane: u32) -> vec2<u32> {
    return vec2((group * LANES) % TILE + lane, (group * LANES) / TILE);
}

// Loads a lane's pixel of a group.
fn load_pixel(group: u32, at: vec2<u32>) {
    let inside = all(at < frame.size);
    let p = select(0u, at.y * frame.size.x + at.x, inside);
    let v = vec3(v_image[3u * p], v_image[3u * p + 1u], v_image[3u * p + 2u]);
    let t = final_t[p];
    pixel_t[group] = select(1.0, t, inside);
    pixel_last[group] = select(0u, last_entry[p], inside);
    pixel_v[group] = v;
    pixel_behind[group] = t * dot(frame.background, v);
    #if INTERSECTIONS
    let plane_size = frame.size.x * frame.size.y;
    pixel_normal[group] = vec3(v_normal_map[3u * p], v_normal_map[3u * p + 1u], v_normal_map[3u * p + 2u]);
    let median = median_depth[p];
    var weights = SURFACE_EPSILON;
    for (var k = 0u; k < frame.intersections; k++) {
        weights += intersections[k * plane_size + p].y;
    }
    let v_median = v_median_depth[p] / weights;
    var left = 0u;
    for (var k = 0u; k < frame.intersections; k++) {
        let entry = intersection_entries[k * plane_size + p];
        let intersection = intersections[k * plane_size + p];
        let v_intersection = v_intersections[k * plane_size + p];
        if entry != NO_ENTRY {
            left++;
            let v_z = v_intersection.x + v_median * intersection.y;
            event_entry[left * GROUPS + group] = entry;
            event[left * GROUPS + group] = vec2(
                v_intersection.y + v_median * (intersection.x - median),
                -v_z * intersection.x * intersection.x,
            );
        }
    }
    pixel_left[group] = left;
    #endif
}

@compute @workgroup_size(LANES)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(subgroup_invocation_id) lane: u32) {
    let tile = tile_of(wid);
    let corner = corner_of(tile);
    let start = tile_ranges[2u * tile];
    let length = tile_ranges[2u * tile + 1u] - start;
    var walked = 0u;
    for (var group = 0u; group < GROUPS; group++) {
        load_pixel(group, corner + pixel_of(group, lane));
        walked = max(walked, pixel_last[group]);
    }
    walked = most(walked, lane);

    // Entries that no pixel reached have rows too.
    for (var k = walked + lane; k < length; k += LANES) {
        let row = sorted_isects[start + k];
        v_isect_color[row] = vec4(0.0);
        v_isect_xy[row] = vec4(0.0);
        v_isect_cov[row] = vec4(0.0);
        #if INTERSECTIONS
        v_isect_plane[row] = vec4(0.0);
        #endif
    }

    for (var c = (walked + LANES - 1u) / LANES; c > 0u; c--) {
        let first = (c - 1u) * LANES;
        let k = first + lane;
        let g = sorted_gaussians[start + min(k, length - 1u)];
        let a = projected[3u * g];
        let b = projected[3u * g + 1u];
        let color = projected[3u * g + 2u].rgb;
        var v_color = vec3(0.0);
        var v_log_opacity = 0.0;
        var v_xy = vec2(0.0);
        var v_abs = vec2(0.0);
        var v_cov = vec3(0.0);
        #if INTERSECTIONS
        let plane = planes[g];
        let over_distance = select(0.0, 1.0 / plane.w, plane.w != 0.0);
        var v_facing = vec3(0.0);
        var v_ray = vec3(0.0);
        #endif
        // The others are not reached by any of the lanes' entries.
        let rows = tile_rows(a.y - f32(corner.y), vec3(a.zw, b.x), b.y);
        let behind_rows = most(rows.y, lane) * (TILE / LANES);
        for (var group = (TILE - most(TILE - rows.x, lane)) * (TILE / LANES); group < behind_rows; group++) {
            var own_t = pixel_t[group];
            var own_behind = pixel_behind[group];
            let own_last = pixel_last[group];
            let own_v = pixel_v[group];
            let group_at = vec2<f32>(corner + pixel_of(group, 0u));
            #if INTERSECTIONS
            let own_normal = pixel_normal[group];
            #repeat i 8
            var extra_$i = 0.0;
            var h_$i = 0.0;
            #end
            var left = pixel_left[group];
            var next = event_entry[left * GROUPS + group];
            loop {
                let here = left > 0u && next >= first;
                let number = select(LANES, next - first, here);
                let own_event = event[left * GROUPS + group];
                #repeat i 8
                {
                    let hit = subgroupShuffle(number, $iu) == lane;
                    extra_$i += select(0.0, subgroupShuffle(own_event.x, $iu), hit);
                    h_$i += select(0.0, subgroupShuffle(own_event.y, $iu), hit);
                }
                #end
                left -= u32(here);
                next = event_entry[left * GROUPS + group];
                if most(u32(left > 0u && next >= first), lane) == 0u {
                    break;
                }
            }
            pixel_left[group] = left;
            #endif
            #repeat i 8
            {
                let at = group_at + vec2($i.0, 0.0);
                let d = a.xy - at;
                let raw = b.y * exp(-falloff(d, vec3(a.zw, b.x)));
                let alpha = min(ALPHA_MAX, raw);
                let counts = k < subgroupShuffle(own_last, $iu) && alpha >= ALPHA_MIN;
                let through = select(1.0, 1.0 - alpha, counts);
                let t = subgroupShuffle(own_t, $iu) / product_behind(through, lane);
                let w = select(0.0, alpha * t, counts);
                let v = vec3(subgroupShuffle(own_v.r, $iu), subgroupShuffle(own_v.g, $iu), subgroupShuffle(own_v.b, $iu));
                var v_weight = dot(color, v);
                #if INTERSECTIONS
                let v_normal = vec3(
                    subgroupShuffle(own_normal.x, $iu),
                    subgroupShuffle(own_normal.y, $iu),
                    subgroupShuffle(own_normal.z, $iu),
                );
                v_weight += dot(plane.xyz, v_normal) + extra_$i;
                v_facing = fma(vec3(w), v_normal, v_facing);
                v_ray = fma(vec3(select(0.0, h_$i * over_distance, counts)), pixel_ray(at), v_ray);
                #endif
                let sum = sum_behind(select(0.0, w * v_weight, counts), lane);
                let behind = subgroupShuffle(own_behind, $iu);
                let q = select(
                    0.0,
                    alpha * (t * v_weight - (behind + from_behind(sum, lane, 1u, 0.0)) / through),
                    counts && raw <= ALPHA_MAX,
                );
                // g = conic d, so that d(-falloff)/d(xy) = -g and d(-falloff)/d(cov) = g g^T / 2.
                let gy = (d.y - a.w * d.x) * b.x;
                let g = vec2(d.x * a.z - a.w * gy, gy);
                let qg = q * g;
                v_color = fma(vec3(w), v, v_color);
                v_log_opacity += q;
                v_xy += qg;
                v_abs += abs(qg);
                v_cov = fma(qg.xxy, g.xyy, v_cov);
                own_t = select(own_t, subgroupShuffle(t, 0u), lane == $iu);
                own_behind = select(own_behind, behind + subgroupShuffle(sum, 0u), lane == $iu);
            }
            #end
            pixel_t[group] = own_t;
            pixel_behind[group] = own_behind;
        }
        if k < walked {
            let row = sorted_isects[start + k];
            // q is taken by the logarithm of alpha; dL/d(opacity) = q / opacity.
            v_isect_color[row] = vec4(v_color, v_log_opacity / b.y);
            v_isect_xy[row] = vec4(-v_xy, v_abs);
            v_isect_cov[row] = vec4(v_cov * vec3(0.5, 1.0, 0.5), 0.0);
            #if INTERSECTIONS
            // dz/dD = z / D, and h (n_c . r + 1e-8) = z dL/dz.
            let v_distance = (dot(plane.xyz, v_ray) + SURFACE_EPSILON * v_ray.z) / plane.w;
            v_isect_plane[row] = vec4(v_facing - v_ray, select(0.0, v_distance, plane.w > 0.0));
            #endif
        }
    }
}
