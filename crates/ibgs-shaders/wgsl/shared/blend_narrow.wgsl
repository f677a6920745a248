// blend.wgsl for processors, without workgroup memory. A driver in software reads memory lane by lane, takes both sides of a branch,
// and exchanges lanes in one instruction. So a subgroup has a block of 8 x 4 pixels, of which each lane has the four of a column. Its
// lanes read as many list entries at once and test them against the block; those that may reach it go to all lanes, one after the
// other. The image is that of the other forms, bit for bit.
#import block

// Of a column's pixels.
const ROWS: u32 = 4u;
// The first of the shift registers' four places that is wanted.
#if DEEP
const FIRST: u32 = 0u;
#else
const FIRST: u32 = 2u;
#endif

@compute @workgroup_size(TILE * TILE / ROWS)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(subgroup_id) subgroup: u32,
    @builtin(subgroup_invocation_id) lane: u32,
) {
    let tile = tile_of(wid);
    let corner = corner_of(tile) + block_corner(subgroup);
    let pixel = corner + vec2(lane, 0u);
    let block = vec2<f32>(corner);
    let at_x = f32(pixel.x);
    let at_y = f32(pixel.y) + vec4(0.0, 1.0, 2.0, 3.0);
    let start = tile_ranges[2u * tile];
    let end = tile_ranges[2u * tile + 1u];
    var done = vec4(pixel.x >= frame.size.x) | (vec4(pixel.y) + vec4(0u, 1u, 2u, 3u) >= vec4(frame.size.y));
    var t = vec4(1.0);
    #if COLOR
    var red = vec4(0.0);
    var green = vec4(0.0);
    var blue = vec4(0.0);
    #endif
    #if ENTRIES
    var last = vec4(0u);
    #if PLANES
    var before_e: array<vec4<u32>, 4>;
    var after_e: array<vec4<u32>, 4>;
    #repeat s 4
    before_e[$s] = vec4(NO_ENTRY);
    after_e[$s] = vec4(NO_ENTRY);
    #end
    #endif
    #endif
    #if PLANES
    let half = frame.intersections / 2u;
    // Shift registers, newest last: `before` keeps what came last, `after` closes when it holds K/2.
    var before_z: array<vec4<f32>, 4>;
    var before_w: array<vec4<f32>, 4>;
    var after_count = vec4(0u);
    #if INTERSECTIONS
    var normal_x = vec4(0.0);
    var normal_y = vec4(0.0);
    var normal_z = vec4(0.0);
    var after_z: array<vec4<f32>, 4>;
    var after_w: array<vec4<f32>, 4>;
    #else
    var after_sum = vec4(0.0);
    var after_weights = vec4(0.0);
    #endif
    #endif
    for (var first = start; first < end; first += LANES) {
        let g = sorted_gaussians[min(first + lane, end - 1u)];
        let own_a = projected[3u * g];
        let own_b = projected[3u * g + 1u];
        #if COLOR
        let own_color = projected[3u * g + 2u];
        #endif
        #if PLANES
        let own_plane = planes[g];
        #endif
        let reaches = first + lane < end && reaches_block(block - own_a.xy, vec3(own_a.zw, own_b.x), own_b.y);
        var left = subgroupBallot(reaches).x;
        while left != 0u {
            let j = firstTrailingBit(left);
            left &= left - 1u;
            let a = subgroupShuffle(own_a, j);
            let b = subgroupShuffle(own_b.xy, j);
            let dx = a.x - at_x;
            let u = (a.y - at_y) - a.w * dx;
            let power = 0.5 * (dx * dx * a.z + u * u * b.x);
            let alpha = min(vec4(ALPHA_MAX), b.y * exp(-power));
            let after = t * (1.0 - alpha);
            let reached = !(done | (alpha < vec4(ALPHA_MIN)));
            let stops = reached & (after < vec4(T_MIN));
            done = done | stops;
            let counts = reached & !stops;
            let weight = alpha * t;
            #if COLOR
            let color = subgroupShuffle(own_color.rgb, j);
            red = select(red, red + weight * color.r, counts);
            green = select(green, green + weight * color.g, counts);
            blue = select(blue, blue + weight * color.b, counts);
            #endif
            #if ENTRIES
            let entry = vec4(first + j - start);
            last = select(last, entry + 1u, counts);
            #endif
            #if PLANES
            let plane = subgroupShuffle(own_plane, j);
            #if INTERSECTIONS
            normal_x = select(normal_x, normal_x + weight * plane.x, counts);
            normal_y = select(normal_y, normal_y + weight * plane.y, counts);
            normal_z = select(normal_z, normal_z + weight * plane.z, counts);
            #endif
            let z = vec4(
                plane_depth(plane, pixel_ray(vec2(at_x, at_y.x))),
                plane_depth(plane, pixel_ray(vec2(at_x, at_y.y))),
                plane_depth(plane, pixel_ray(vec2(at_x, at_y.z))),
                plane_depth(plane, pixel_ray(vec2(at_x, at_y.w))),
            );
            let meets = counts & (z > vec4(0.0));
            let is_before = meets & (t > vec4(MEDIAN_T));
            let is_after = meets & !is_before & (after_count < vec4(half));
            #if DEEP
            #repeat s 3
            #else
            #repeat s 1
            #endif
            before_z[FIRST + $su] = select(before_z[FIRST + $su], before_z[FIRST + $su + 1u], is_before);
            before_w[FIRST + $su] = select(before_w[FIRST + $su], before_w[FIRST + $su + 1u], is_before);
            #if INTERSECTIONS
            after_z[FIRST + $su] = select(after_z[FIRST + $su], after_z[FIRST + $su + 1u], is_after);
            after_w[FIRST + $su] = select(after_w[FIRST + $su], after_w[FIRST + $su + 1u], is_after);
            #if ENTRIES
            before_e[FIRST + $su] = select(before_e[FIRST + $su], before_e[FIRST + $su + 1u], is_before);
            after_e[FIRST + $su] = select(after_e[FIRST + $su], after_e[FIRST + $su + 1u], is_after);
            #endif
            #endif
            #end
            before_z[3] = select(before_z[3], z, is_before);
            before_w[3] = select(before_w[3], weight, is_before);
            #if INTERSECTIONS
            after_z[3] = select(after_z[3], z, is_after);
            after_w[3] = select(after_w[3], weight, is_after);
            #if ENTRIES
            before_e[3] = select(before_e[3], entry, is_before);
            after_e[3] = select(after_e[3], entry, is_after);
            #endif
            #else
            after_sum = select(after_sum, after_sum + z * weight, is_after);
            after_weights = select(after_weights, after_weights + weight, is_after);
            #endif
            after_count += select(vec4(0u), vec4(1u), is_after);
            #endif
            t = select(t, after, counts);
            #if COLOR
            #else
            done = done | (after_count == vec4(half));
            #endif
        }
        if subgroupAll(all(done)) {
            break;
        }
    }
    #repeat r 4
    if all(pixel + vec2(0u, $ru) < frame.size) {
        let p = (pixel.y + $ru) * frame.size.x + pixel.x;
        #if COLOR
        let out = vec3(red[$r], green[$r], blue[$r]) + t[$r] * frame.background;
        image[3u * p] = out.r;
        image[3u * p + 1u] = out.g;
        image[3u * p + 2u] = out.b;
        #if TRANSMITTANCE_BEHIND
        normal_map[3u * frame.size.x * frame.size.y + p] = t[$r];
        #else
        final_t[p] = t[$r];
        #endif
        #endif
        #if ENTRIES
        last_entry[p] = last[$r];
        #endif
        #if PLANES
        #if INTERSECTIONS
        normal_map[3u * p] = normal_x[$r];
        normal_map[3u * p + 1u] = normal_y[$r];
        normal_map[3u * p + 2u] = normal_z[$r];
        let plane_size = frame.size.x * frame.size.y;
        var sum = 0.0;
        var weights = 0.0;
        #repeat s 4
        if $su + half >= 4u {
            let k = ($su + half - 4u) * plane_size + p;
            let before = vec2(before_z[$s][$r], before_w[$s][$r]);
            let after = vec2(after_z[$s][$r], after_w[$s][$r]);
            intersections[k] = before;
            intersections[half * plane_size + k] = after;
            #if ENTRIES
            intersection_entries[k] = before_e[$s][$r];
            intersection_entries[half * plane_size + k] = after_e[$s][$r];
            #endif
            sum += before.x * before.y + after.x * after.y;
            weights += before.y + after.y;
        }
        #end
        #else
        let kept = vec4(0u, 1u, 2u, 3u) >= vec4(4u - half);
        let z = vec4(before_z[0][$r], before_z[1][$r], before_z[2][$r], before_z[3][$r]);
        let w = vec4(before_w[0][$r], before_w[1][$r], before_w[2][$r], before_w[3][$r]);
        let weight = select(vec4(0.0), w, kept);
        let sum = dot(weight, z) + after_sum[$r];
        let weights = dot(weight, vec4(1.0)) + after_weights[$r];
        #endif
        median_depth[p] = sum / (weights + SURFACE_EPSILON);
        #endif
    }
    #end
}
