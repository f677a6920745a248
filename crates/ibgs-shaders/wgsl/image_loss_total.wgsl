//! L1 + SSIM, sum over the tiles.
#set train
#stage image loss
// One workgroup: sums the tiles' partial sums in a fixed order. stats = (loss, mean |x - y|, mean SSIM, mean squared error).
#import ssim
#import reduce

@group(0) @binding(0) var<storage, read> partials: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read_write> loss: array<f32>;
@group(0) @binding(2) var<storage, read_write> stats: array<f32>;

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) local: u32) {
    let count = 3u * params.tiles.x * params.tiles.y;
    var sum = vec4(0.0);
    for (var i = local; i < count; i += 256u) {
        sum += partials[i];
    }
    let total = reduce(local, sum);
    if local == 0u {
        let mean = total / (3.0 * f32(params.size.x * params.size.y));
        let value = (1.0 - params.lambda) * mean.x + params.lambda * (1.0 - mean.y);
        loss[0] = value;
        stats[0] = value;
        stats[1] = mean.x;
        stats[2] = mean.y;
        stats[3] = mean.z;
    }
}
