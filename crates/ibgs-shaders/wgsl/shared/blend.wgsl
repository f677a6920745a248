// Front-to-back blending, one workgroup a tile, one thread a pixel, with early stop. COLOR: colour and transmittance.
// PLANES: the median depth, from the ray's intersections with the Gaussians' planes. INTERSECTIONS, with both: the normal map and
// the intersections themselves too. ENTRIES: also the list entries that gradients need. TRANSMITTANCE_BEHIND: the transmittance lies
// behind the normals. The median depth alone is done with a pixel when its buffer `after` is full. SUBGROUPS: half a subgroup walks
// only the entries that may reach its pixels; the image is the same bit for bit. STRAIGHT: all lanes take an entry, whether it
// counts or not, as branches cost more than they leave out. NARROW: processors have a form of their own.

#import tile_order
#if NARROW
#import blend_narrow
#else
#if SUBGROUPS
#import block_half
#if COLOR
#define STRAIGHT
#endif
#endif

#import blend_batch
#if PLANES
#import median_registers
#endif

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
    #if SUBGROUPS
    @builtin(subgroup_id) subgroup: u32,
    @builtin(subgroup_invocation_id) lane: u32,
    #endif
) {
    let tile = tile_of(wid);
    #if SUBGROUPS
    let pixel = corner_of(tile) + half_pixel(subgroup, lane);
    let block = vec2<f32>(corner_of(tile) + block_corner(subgroup));
    #else
    let pixel = corner_of(tile) + vec2(local % TILE, local / TILE);
    #endif
    let inside = all(pixel < frame.size);
    let at = vec2<f32>(pixel);
    let start = tile_ranges[2u * tile];
    let end = tile_ranges[2u * tile + 1u];
    begin(local);
    var t = 1.0;
    #if COLOR
    var color = vec3(0.0);
    #endif
    #if ENTRIES
    var last = 0u;
    #if PLANES
    var before_e = vec4(NO_ENTRY);
    var after_e = vec4(NO_ENTRY);
    #endif
    #endif
    #if PLANES
    let ray = pixel_ray(at);
    let half = frame.intersections / 2u;
    // `before` keeps what came last, `after` closes when it holds K/2.
    var before_z = vec4(0.0);
    var before_w = vec4(0.0);
    var after_count = 0u;
    #if INTERSECTIONS
    var normal = vec3(0.0);
    var after_z = vec4(0.0);
    var after_w = vec4(0.0);
    #else
    var after_sum = 0.0;
    var after_weights = 0.0;
    #endif
    #endif
    var done = !inside;
    if done {
        atomicAdd(&finished, 1u);
    }
    #if STRAIGHT
    var told = done;
    #endif
    for (var first = start; first < end; first += BATCH) {
        if all_finished(local) {
            break;
        }
        load_entry(local, first, end);
        workgroupBarrier();
        let size = min(BATCH, end - first);
        #if SUBGROUPS
        for (var group = 0u; group < size; group += LANES) {
            let own = group + lane;
            let own_a = batch[ENTRY * own];
            let own_b = batch[ENTRY * own + 1u];
            var left = reaching_half(lane, own < size, block - own_a.xy, vec3(own_a.zw, own_b.x), own_b.zw);
            if subgroupAll(done) {
                break;
            }
            #if STRAIGHT
            while left != 0u {
            #else
            while left != 0u && !done {
            #endif
                let j = group + firstTrailingBit(left);
                left &= left - 1u;
        #else
        if !done {
            for (var j = 0u; j < size; j++) {
        #endif
                let a = batch[ENTRY * j];
                let b = batch[ENTRY * j + 1u];
                let alpha = min(ALPHA_MAX, b.y * exp(-falloff(a.xy - at, vec3(a.zw, b.x))));
                #if STRAIGHT
                let after = t * (1.0 - alpha);
                let reached = !done & (alpha >= ALPHA_MIN);
                let counts = reached & (after >= T_MIN);
                done |= reached & !counts;
                #else
                if alpha < ALPHA_MIN {
                    continue;
                }
                let after = t * (1.0 - alpha);
                if after < T_MIN {
                    done = true;
                    atomicAdd(&finished, 1u);
                    break;
                }
                const counts = true;
                #endif
                let weight = select(0.0, alpha * t, counts);
                #if COLOR
                color += weight * batch[ENTRY * j + COLOR_ROW].rgb;
                #endif
                #if ENTRIES
                let entry = first + j - start;
                last = select(last, entry + 1u, counts);
                #endif
                #if PLANES
                let plane = batch[ENTRY * j + PLANE_ROW];
                #if INTERSECTIONS
                normal += weight * plane.xyz;
                #endif
                // Nothing more to do once both buffers are closed.
                let wanted = counts & (t > MEDIAN_T || after_count < half);
                var z = 0.0;
                if wanted {
                    z = plane_depth(plane, ray);
                }
                if z > 0.0 {
                    if t > MEDIAN_T {
                        before_z = pushed(before_z, z);
                        before_w = pushed(before_w, weight);
                        #if ENTRIES
                        before_e = pushed_entry(before_e, entry);
                        #endif
                    } else if after_count < half {
                        #if INTERSECTIONS
                        after_z = pushed(after_z, z);
                        after_w = pushed(after_w, weight);
                        #if ENTRIES
                        after_e = pushed_entry(after_e, entry);
                        #endif
                        #else
                        after_sum += z * weight;
                        after_weights += weight;
                        #endif
                        after_count += 1u;
                    }
                }
                #endif
                t = select(t, after, counts);
                #if COLOR
                #else
                if after_count == half {
                    done = true;
                    atomicAdd(&finished, 1u);
                    break;
                }
                #endif
            }
        }
        #if STRAIGHT
        if done & !told {
            told = true;
            atomicAdd(&finished, 1u);
        }
        #endif
    }
    if inside {
        let p = pixel.y * frame.size.x + pixel.x;
        #if COLOR
        let out = color + t * frame.background;
        image[3u * p] = out.r;
        image[3u * p + 1u] = out.g;
        image[3u * p + 2u] = out.b;
        #if TRANSMITTANCE_BEHIND
        normal_map[3u * frame.size.x * frame.size.y + p] = t;
        #else
        final_t[p] = t;
        #endif
        #endif
        #if ENTRIES
        last_entry[p] = last;
        #endif
        #if PLANES
        #if INTERSECTIONS
        normal_map[3u * p] = normal.x;
        normal_map[3u * p + 1u] = normal.y;
        normal_map[3u * p + 2u] = normal.z;
        let plane_size = frame.size.x * frame.size.y;
        // Copies: a register that is indexed by a variable would live in memory all along.
        let bz = before_z;
        let bw = before_w;
        let az = after_z;
        let aw = after_w;
        #if ENTRIES
        let be = before_e;
        let ae = after_e;
        #endif
        var sum = 0.0;
        var weights = 0.0;
        for (var k = 0u; k < half; k++) {
            let c = 4u - half + k;
            intersections[k * plane_size + p] = vec2(bz[c], bw[c]);
            intersections[(half + k) * plane_size + p] = vec2(az[c], aw[c]);
            #if ENTRIES
            intersection_entries[k * plane_size + p] = be[c];
            intersection_entries[(half + k) * plane_size + p] = ae[c];
            #endif
            sum += bz[c] * bw[c] + az[c] * aw[c];
            weights += bw[c] + aw[c];
        }
        #else
        let kept = select(vec4(0.0), before_w, vec4(0u, 1u, 2u, 3u) >= vec4(4u - half));
        let sum = dot(kept, before_z) + after_sum;
        let weights = dot(kept, vec4(1.0)) + after_weights;
        #endif
        median_depth[p] = sum / (weights + SURFACE_EPSILON);
        #endif
    }
}
#endif
