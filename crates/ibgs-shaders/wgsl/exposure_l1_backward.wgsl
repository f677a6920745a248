// A fixed number of workgroups: exchanges the plain L1's gradient in v_image for that of |exp(a) x + b - y|, and sums
// the gradients by a and b; all only while the SSIM gate of exposure_l1_total is open. With a = b = 0 nothing changes.
#import ssim
#import reduce

@group(0) @binding(0) var<storage, read> image: array<f32>;
@group(0) @binding(1) var<storage, read> photo: array<u32>;
@group(0) @binding(2) var<storage, read> scalars: array<f32>;
@group(0) @binding(3) var<storage, read> stats: array<f32>;
@group(0) @binding(4) var<storage, read> v_loss: array<f32>;
@group(0) @binding(5) var<storage, read_write> v_image: array<f32>;
@group(0) @binding(6) var<storage, read_write> partials: array<vec2<f32>>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let pixels = params.size.x * params.size.y;
    let gain = exp(scalars[0]);
    let offset = scalars[1];
    let scale = v_loss[0] * (1.0 - params.lambda) / (3.0 * f32(pixels));
    let open = 1.0 - stats[2] < EXPOSURE_SSIM;
    var sum = vec2(0.0);
    for (var p = wid.x * 256u + local; p < pixels; p += EXPOSURE_GROUPS * 256u) {
        let texel = photo[p];
        if open && target_counts(texel) {
            let share = background_share(texel);
            for (var c = 0u; c < 3u; c++) {
                let x = image[3u * p + c];
                let y = target_channel(texel, c);
                let behind = share * params.background[c];
                let side = sign(gain * x + offset - y - (gain - 1.0) * behind - share * offset);
                sum += side * vec2(gain * (x - behind), 1.0 - share);
                v_image[3u * p + c] += scale * (gain * side - sign(x - y));
            }
        }
    }
    let total = reduce(local, vec4(sum, 0.0, 0.0));
    if local == 0u {
        partials[wid.x] = scale * total.xy;
    }
}
