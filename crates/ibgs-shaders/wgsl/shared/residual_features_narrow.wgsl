// One subgroup a workgroup, which has as many pixels as another form's. The lanes are pixels where they read the image, and channels
// where they compute.
#import residual_mlp_narrow

// [pixel][q] of channels 8 q + lane: of one source, and merged.
var<private> given: array<vec4<f32>, LANES>;
var<private> merged: array<vec4<f32>, LANES>;

// Runs the MLP on a visible source of eight pixels, of which `f` is the lane's, and so is `start`, the logarithm of the confidence before
// the hidden channels' part. Returns the whole of it for the lane's.
fn give(f: Feature, start: f32, lane: u32) -> f32 {
    var own = 0.0;
    for (var p = 0u; p < LANES; p++) {
        forward(f, p);
        given[p] = vec4(outputs[0], outputs[1], outputs[2], outputs[3]);
        var confidence = subgroupShuffle(start, p);
        #repeat j 8
        confidence += dot(
            vec4(all_hidden[4 * $j], all_hidden[4 * $j + 1], all_hidden[4 * $j + 2], all_hidden[4 * $j + 3]),
            vec4(
                subgroupBroadcast(by_hidden[$j / 2], 4u * ($ju % 2u)),
                subgroupBroadcast(by_hidden[$j / 2], 4u * ($ju % 2u) + 1u),
                subgroupBroadcast(by_hidden[$j / 2], 4u * ($ju % 2u) + 2u),
                subgroupBroadcast(by_hidden[$j / 2], 4u * ($ju % 2u) + 3u),
            ),
        );
        #end
        own = select(own, confidence, lane == p);
    }
    return own;
}

// Writes the eight pixels from `start` on; `scale` is for the lane's.
fn store(start: u32, pixels: u32, c: Corners, scale: f32, lane: u32) {
    #repeat p 8
    {
        let values = subgroupShuffle(scale, $pu) * merged[$p];
        #if PACKED
        // The channels of a word are those of two lanes.
        let others = subgroupShuffle(values, lane ^ 1u);
        if start + $pu < pixels && lane % 2u == 0u {
            #repeat q 4
            x[(4u * $qu + lane / 2u) * pixels + start + $pu] = word(values[$q], others[$q]);
            #end
        }
        #else
        if start + $pu < pixels {
            #repeat q 4
            x[(8u * $qu + lane) * pixels + start + $pu] = values[$q];
            #end
        }
        #endif
    }
    #end
    let last = ray_and_color(c);
    if start + lane < pixels {
        put(RAY_CHANNEL, start + lane, last.head);
        put(RAY_CHANNEL + 4u, start + lane, last.tail);
    }
}

@compute @workgroup_size(LANES)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(subgroup_invocation_id) lane: u32,
) {
    load_mlp(lane);
    let pixels = params.low.x * params.low.y;
    let used = used_sources();
    let is_soft = params.aggregation == AGGREGATION_SOFT;
    let first = linear_workgroup(wid, groups) * THREADS;
    for (var start = first; start < min(first + THREADS, pixels); start += LANES) {
        let own = min(start + lane, pixels - 1u);
        let c = resize_corners(vec2(own % params.low.x, own / params.low.x), params.size, params.low);
        #repeat p 8
        merged[$p] = vec4(0.0);
        #end
        // Largest logarithm of a confidence so far and the sum of the confidences over its exponential; that of no source is 1.
        var top = 0.0;
        var confidences = 1.0;
        for (var m = 0u; m < used; m++) {
            let present = presence(c, m);
            let confidence = give(feature(c, m), by_error.x * present.y + by_error.y, lane);
            let is_there = present.x > 0.0;
            let next = select(top, max(top, confidence), is_there);
            let kept = select(1.0, exp(top - next), is_soft);
            let share = select(1.0, select(0.0, present.x * exp(confidence - next), is_there), is_soft);
            confidences = kept * confidences + share;
            top = next;
            #repeat p 8
            merged[$p] = merge(merged[$p], given[$p], subgroupShuffle(kept, $pu), subgroupShuffle(share, $pu));
            #end
        }
        store(start, pixels, c, merged_scale(used, confidences), lane);
    }
}
