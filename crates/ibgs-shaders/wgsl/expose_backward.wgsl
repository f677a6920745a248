//! Gradient by the image; sums of those by the exposure.
#set train
#stage other
// A fixed number of workgroups, each over its share of the pixels: the gradient by the image, v_x = exp(g) v, and sums of those
// by log gains and offsets. The transmittance is a constant.
#import reduce
#import expose_params

@group(0) @binding(0) var<storage, read> exposures: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> image: array<f32>;
@group(0) @binding(2) var<storage, read> transmittance: array<f32>;
@group(0) @binding(3) var<storage, read> v_exposed: array<f32>;
@group(0) @binding(4) var<storage, read_write> v_image: array<f32>;
/// Two a workgroup.
@group(0) @binding(5) var<storage, read_write> partials: array<vec4<f32>>;

const THREADS: u32 = 256u;

@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let gain = exp(exposures[0].xyz);
    var by_gain = vec3(0.0);
    var by_offset = vec3(0.0);
    for (var p = wid.x * THREADS + local; p < params.pixels; p += EXPOSURE_GROUPS * THREADS) {
        let t = transmittance[params.transmittance + p];
        let x = vec3(image[3u * p], image[3u * p + 1u], image[3u * p + 2u]);
        let v = vec3(v_exposed[3u * p], v_exposed[3u * p + 1u], v_exposed[3u * p + 2u]);
        let v_x = gain * v;
        by_gain += v_x * (x - t * params.background);
        by_offset += (1.0 - t) * v;
        for (var c = 0u; c < 3u; c++) {
            v_image[3u * p + c] = v_x[c];
        }
    }
    let total_gain = reduce(local, vec4(by_gain, 0.0));
    let total_offset = reduce(local, vec4(by_offset, 0.0));
    if local == 0u {
        partials[2u * wid.x] = total_gain;
        partials[2u * wid.x + 1u] = total_offset;
    }
}
