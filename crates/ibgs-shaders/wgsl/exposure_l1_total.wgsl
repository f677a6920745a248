// One workgroup: puts the L1 of the exposed image into the loss in place of the plain one, while the plain image's
// 1 - SSIM is under the limit. stats = (loss, mean |x - y|, mean SSIM, mean squared error) of image_loss_total; only
// the loss in it changes.
#import ssim
#import reduce

@group(0) @binding(0) var<storage, read> partials: array<vec2<f32>>;
@group(0) @binding(1) var<storage, read_write> loss: array<f32>;
@group(0) @binding(2) var<storage, read_write> stats: array<f32>;

@compute @workgroup_size(EXPOSURE_GROUPS)
fn main(@builtin(local_invocation_index) local: u32) {
    let sum = reduce(local, vec4(partials[local], 0.0, 0.0)).x;
    if local == 0u && 1.0 - stats[2] < EXPOSURE_SSIM {
        let mean = sum / (3.0 * f32(params.size.x * params.size.y));
        let value = (1.0 - params.lambda) * mean + params.lambda * (1.0 - stats[2]);
        loss[0] = value;
        stats[0] = value;
    }
}
