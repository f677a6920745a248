//! The final colour towards the sources' mean colour.
#set render
#stage compose
// One thread a pixel: moves the final colour towards the mean colour of the sources that see its point, the more of them look
// from about the same direction and agree in depth.
#import index
#import seen

/// The sources' share in the final colour.
struct MixParams {
    /// Number of pixels.
    pixels: u32,
    /// Visible sources a pixel, V.
    visible: u32,
    /// Most weight of the sources' mean colour.
    share: f32,
    /// Distance of the unit viewing directions at which a source counts 1/e.
    angle: f32,
    /// What stands against the sources' weights.
    doubt: f32,
}

var<immediate> params: MixParams;

/// V planes of (r, g, b, cosine).
@group(0) @binding(0) var<storage, read> warped: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> seen: array<u32>;
@group(0) @binding(2) var<storage, read_write> image: array<f32>;

// Weight of a source whose depth is off by `error` times what agrees.
fn weight(error: f32, cosine: f32) -> f32 {
    let apart = sqrt(max(2.0 - 2.0 * cosine, 0.0));
    return exp(-0.5 * error * error - apart / params.angle);
}

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let p = linear_workgroup(wid, groups) * 256u + local;
    if p >= params.pixels {
        return;
    }
    var sum = vec4(0.0);
    for (var m = 0u; m < params.visible; m++) {
        if is_seen(seen[p], m) {
            let read = warped[m * params.pixels + p];
            sum += weight(relative_error(seen[p], m), read.w) * vec4(read.rgb, 1.0);
        }
    }
    if sum.w > 0.0 {
        let own = vec3(image[3u * p], image[3u * p + 1u], image[3u * p + 2u]);
        let mixed = own + params.share / (sum.w + params.doubt) * (sum.rgb - sum.w * own);
        image[3u * p] = mixed.x;
        image[3u * p + 1u] = mixed.y;
        image[3u * p + 2u] = mixed.z;
    }
}
