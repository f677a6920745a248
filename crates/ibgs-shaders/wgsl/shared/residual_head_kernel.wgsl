// The head's weights in workgroup memory.
#import residual_head

// [input][output quad], and the last layer's [output][quad of f].
var<workgroup> fuse: array<array<vec4<f32>, 10>, INPUTS>;
var<workgroup> last: array<array<vec4<f32>, 10>, OUTPUTS>;

fn fuse_weight(o: u32, i: u32) -> f32 {
    if o >= WIDTH {
        return 0.0;
    }
    return weights[params.fuse + o * INPUTS + i];
}

fn last_weight(c: u32, o: u32) -> f32 {
    if o >= WIDTH {
        return 0.0;
    }
    return weights[params.last + c * WIDTH + o];
}

fn load_head(local: u32) {
    for (var k = local; k < INPUTS * 10u; k += 128u) {
        let o = 4u * (k / INPUTS);
        let i = k % INPUTS;
        fuse[i][k / INPUTS] =
            vec4(fuse_weight(o, i), fuse_weight(o + 1u, i), fuse_weight(o + 2u, i), fuse_weight(o + 3u, i));
    }
    if local < 10u * OUTPUTS {
        let c = local / 10u;
        let o = 4u * (local % 10u);
        last[c][local % 10u] = vec4(last_weight(c, o), last_weight(c, o + 1u), last_weight(c, o + 2u), last_weight(c, o + 3u));
    }
    workgroupBarrier();
}

// A thread's four pixels lie 128 apart, so that neighbouring threads read neighbouring values.
fn pixels_of(workgroup: u32, local: u32) -> vec4<u32> {
    return workgroup * 512u + local + vec4(0u, 128u, 256u, 384u);
}
