// A fixed number of workgroups: sum of |exp(a) x + b - y| over the valid pixels and channels (method.md section 8).
// The background in y has the exposure of the photo too.
#import ssim
#import reduce

@group(0) @binding(0) var<storage, read> image: array<f32>;
@group(0) @binding(1) var<storage, read> photo: array<u32>;
// (a, b) of the photo.
@group(0) @binding(2) var<storage, read> scalars: array<f32>;
@group(0) @binding(3) var<storage, read_write> partials: array<vec2<f32>>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let gain = exp(scalars[0]);
    let offset = scalars[1];
    var sum = 0.0;
    for (var p = wid.x * 256u + local; p < params.size.x * params.size.y; p += EXPOSURE_GROUPS * 256u) {
        let texel = photo[p];
        if target_counts(texel) {
            let share = background_share(texel);
            for (var c = 0u; c < 3u; c++) {
                let y = target_channel(texel, c) + share * ((gain - 1.0) * params.background[c] + offset);
                sum += abs(gain * image[3u * p + c] + offset - y);
            }
        }
    }
    let total = reduce(local, vec4(sum, 0.0, 0.0, 0.0));
    if local == 0u {
        partials[wid.x] = total.xy;
    }
}
