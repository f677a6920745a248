//! A loss that is a weighted mean, from the workgroups' sums.
#set train
#stage other
// One workgroup: loss = weight * sum / count over the workgroups' (sum, count), 0 when nothing counts.
// stats = (loss, count).
#import reduce

/// A loss that is a weighted mean.
struct MeanParams {
    /// Partial sums.
    count: u32,
    /// Weight of the mean.
    weight: f32,
}

var<immediate> params: MeanParams;

@group(0) @binding(0) var<storage, read> partials: array<vec2<f32>>;
@group(0) @binding(1) var<storage, read_write> loss: array<f32>;
@group(0) @binding(2) var<storage, read_write> stats: array<f32>;

const THREADS: u32 = 256u;

@compute @workgroup_size(THREADS)
fn main(@builtin(local_invocation_index) local: u32) {
    var sum = vec2(0.0);
    for (var i = local; i < params.count; i += THREADS) {
        sum += partials[i];
    }
    let total = reduce(local, vec4(sum, 0.0, 0.0));
    if local == 0u {
        // A count is a whole number: at least 1 unless nothing counts, and then the sum is 0.
        let value = params.weight * total.x / max(total.y, 1.0);
        loss[0] = value;
        stats[0] = value;
        stats[1] = total.y;
    }
}
