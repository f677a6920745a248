// One thread four channels of a pixel: planes in float32 to half precision, channels last, padded with zeros.
#import half
#import index

struct HalfPackParams {
    pixels: u32,
    channels: u32,
    // Values a pixel behind the packing, divided by 4.
    quads: u32,
}

var<immediate> params: HalfPackParams;

@group(0) @binding(0) var<storage, read> planes: array<f32>;
@group(0) @binding(1) var<storage, read_write> packed: array<vec4<f16>>;

fn plane(c: u32, p: u32) -> f32 {
    return select(0.0, planes[min(c, params.channels - 1u) * params.pixels + p], c < params.channels);
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
    for (var q = 0u; q < params.quads; q++) {
        let c = 4u * q;
        packed[p * params.quads + q] =
            to_half(vec4(plane(c, p), plane(c + 1u, p), plane(c + 2u, p), plane(c + 3u, p)));
    }
}
