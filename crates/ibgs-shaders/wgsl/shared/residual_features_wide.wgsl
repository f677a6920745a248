// One thread a pixel of the network's size. It hands each four of the 38 channels to the `put` of the file that imports it, the last two
// with zeros.
#import residual_mlp

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    load_mlp(local, THREADS);
    let i = linear_workgroup(wid, groups) * THREADS + local;
    if i >= params.low.x * params.low.y {
        return;
    }
    let c = resize_corners(vec2(i % params.low.x, i / params.low.x), params.size, params.low);
    let z = vec4(0.0);
    var sum = Hidden(z, z, z, z, z, z, z, z);
    let used = used_sources();
    // Largest logarithm of a confidence so far and the sum of the confidences over its exponential; that of no source is 1.
    var top = 0.0;
    var total = 1.0;
    var kept = 1.0;
    var share = 1.0;
    for (var m = 0u; m < used; m++) {
        let f = feature(c, m);
        var present = vec2(0.0);
        var confidence = 0.0;
        if params.aggregation == AGGREGATION_SOFT {
            present = presence(c, m);
            confidence = confidence_start(present.y);
        }
        let h = mlp_output(f, &confidence);
        if params.aggregation == AGGREGATION_SOFT {
            let next = select(top, max(top, confidence), present.x > 0.0);
            kept = exp(top - next);
            share = select(0.0, present.x * exp(confidence - next), present.x > 0.0);
            total = kept * total + share;
            top = next;
        }
        sum.a = merge(sum.a, h.a, kept, share);
        sum.b = merge(sum.b, h.b, kept, share);
        sum.c = merge(sum.c, h.c, kept, share);
        sum.d = merge(sum.d, h.d, kept, share);
        sum.e = merge(sum.e, h.e, kept, share);
        sum.f = merge(sum.f, h.f, kept, share);
        sum.g = merge(sum.g, h.g, kept, share);
        sum.h = merge(sum.h, h.h, kept, share);
    }
    let scale = merged_scale(used, total);
    put(0u, i, scale * sum.a);
    put(4u, i, scale * sum.b);
    put(8u, i, scale * sum.c);
    put(12u, i, scale * sum.d);
    put(16u, i, scale * sum.e);
    put(20u, i, scale * sum.f);
    put(24u, i, scale * sum.g);
    put(28u, i, scale * sum.h);
    let last = ray_and_color(c);
    put(RAY_CHANNEL, i, last.head);
    put(RAY_CHANNEL + 4u, i, last.tail);
}
