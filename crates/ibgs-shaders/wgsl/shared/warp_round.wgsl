// The kernels that warp a round of sources; warp.wgsl declares their buffers.
#import source_round
#import seen

var<workgroup> most: atomic<u32>;

// (r, g, b, 1), or zero where a texel is masked.
fn read_photo(l: Landing) -> vec4<f32> {
    let t = texels(l);
    let w = bilinear_weights(l.fraction);
    let color = w.x * unpack4x8unorm(t.x) + w.y * unpack4x8unorm(t.y) + w.z * unpack4x8unorm(t.z)
        + w.w * unpack4x8unorm(t.w);
    let valid = (t.x & t.y & t.z & t.w & 0x80000000u) != 0u;
    return select(vec4(0.0), vec4(color.rgb, 1.0), valid);
}

// The source's depths at the texels of a landing.
fn depths(l: Landing) -> vec4<f32> {
    let at = l.texel;
    let below = at + params.source_size.x;
#if FOUR
    switch slot {
        #repeat s 3
        case $su: {
            return vec4(source_depth$s[at], source_depth$s[at + 1u], source_depth$s[below], source_depth$s[below + 1u]);
        }
        #end
        default: {
            return vec4(source_depth3[at], source_depth3[at + 1u], source_depth3[below], source_depth3[below + 1u]);
        }
    }
#else
    return vec4(source_depth0[at], source_depth0[at + 1u], source_depth0[below], source_depth0[below + 1u]);
#endif
}

// The source's depth at the point less the point's, as a part of the latter; negative where the source has none.
fn depth_error(l: Landing) -> f32 {
    let stored = dot(bilinear_weights(l.fraction), depths(l));
    return select(-1.0, abs(stored - l.depth) / l.depth, stored > 0.0);
}

// Sum of the source's colours at the intersections, and of their weights: zero where the source does not see the point.
// `depth`: error of its depth.
struct Sight {
    sum: vec4<f32>,
    depth: f32,
}

fn look(p: u32, ray: vec3<f32>, z: f32) -> Sight {
    var sight = Sight(vec4(0.0), -1.0);
    let median = land(ray, z);
    if median.inside {
        sight.depth = depth_error(median);
    }
    if sight.depth >= 0.0 && sight.depth < warping.reach * warping.agreement {
        let plane = warping.size.x * warping.size.y;
        // Four at once, so that their reads do not wait for each other; those that do not count weigh nothing.
        for (var first = 0u; first < warping.intersections; first += 4u) {
            #repeat k 4
            let i$k = intersections[min(first + $ku, warping.intersections - 1u) * plane + p];
            let l$k = land(ray, i$k.x);
            let color$k = read_photo(l$k);
            #end
            #repeat k 4
            let counts$k = first + $ku < warping.intersections && i$k.y > 0.0 && l$k.inside;
            sight.sum += select(0.0, i$k.y, counts$k) * color$k;
            #end
        }
    }
    return sight;
}

fn warp_pixel(pixel: vec2<u32>) {
    let plane = warping.size.x * warping.size.y;
    let p = pixel.y * warping.size.x + pixel.x;
    var packed = 0xffffffffu;
    if warping.first > 0u {
        packed = seen[p];
    }
    var count = (32u - countLeadingZeros(~packed) + 7u) / 8u;
    let z = median_depth[p];
    if z > 0.0 {
        for (var s = 0u; s < warping.count && count < warping.visible; s++) {
            take_source(s);
            let ray = source_ray(pixel);
            let sight = look(p, ray, z);
            if sight.sum.w > 0.0 {
                warped[count * plane + p] = vec4(sight.sum.rgb / (sight.sum.w + SOURCE_EPSILON), ray_cosine(ray, z).x);
                let error_step = min(u32(f32(ERROR_STEPS) * sight.depth / warping.agreement), MOST_ERROR);
                let step = select(error_step, 0u, warping.reach == 1.0);
                packed = (packed & ~(255u << (8u * count))) | ((params.index | (step << 4u)) << (8u * count));
                count++;
            }
        }
    }
    // The next round may fill them.
    for (var m = count; m < warping.visible; m++) {
        warped[m * plane + p] = vec4(0.0);
    }
    seen[p] = packed;
    atomicMax(&most, count);
}

@compute @workgroup_size(TILE, TILE)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    if local == 0u {
        atomicStore(&most, 0u);
    }
    workgroupBarrier();
    if all(id.xy < warping.size) {
        warp_pixel(id.xy);
    }
    workgroupBarrier();
    if local == 0u {
        atomicMax(&most_visible[0], atomicLoad(&most));
    }
}
