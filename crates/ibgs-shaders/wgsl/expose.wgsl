//! What the Gaussians show in a photo's exposure.
#set render
#stage other
// One thread a pixel: what the Gaussians show, in a photo's exposure; the background stays as it is.
// out = exp(g) (x - T bg) + (1 - T) o + T bg.
#import index
#import expose_params

/// Rows of (log gains, -), (offsets, -): the target's first.
@group(0) @binding(0) var<storage, read> exposures: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> image: array<f32>;
@group(0) @binding(2) var<storage, read> transmittance: array<f32>;
@group(0) @binding(3) var<storage, read_write> exposed: array<f32>;

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
    let t = transmittance[params.transmittance + p];
    let behind = t * params.background;
    let x = vec3(image[3u * p], image[3u * p + 1u], image[3u * p + 2u]);
    let out = exp(exposures[0].xyz) * (x - behind) + (1.0 - t) * exposures[1].xyz + behind;
    for (var c = 0u; c < 3u; c++) {
        exposed[3u * p + c] = out[c];
    }
}
