//! Random steps of the means.
#set train
#stage other
// One thread a Gaussian: a random step of its mean (Kheradmand et al., 2024): its covariance times a normal vector, large
// only while the Gaussian is nearly transparent.
#import index
#import quaternion
#import hash

/// Random steps of the means.
struct McmcNoiseParams {
    /// Number of Gaussians.
    count: u32,
    /// Seed of this iteration.
    seed: u32,
    /// Gain of the steps of a transparent Gaussian.
    strength: f32,
}

var<immediate> params: McmcNoiseParams;

@group(0) @binding(0) var<storage, read> rotations: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> log_scales: array<f32>;
@group(0) @binding(2) var<storage, read> opacity_logits: array<f32>;
@group(0) @binding(3) var<storage, read_write> means: array<f32>;

const TAU: f32 = 6.2831855;

// Between 0 and 1, both excluded.
fn unit(bits: u32) -> f32 {
    return (f32(bits >> 8u) + 0.5) * 5.9604645e-8;
}

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_workgroup(wid, groups) * 256u + local;
    if i >= params.count {
        return;
    }
    let a = hash(i ^ params.seed);
    let b = hash(a);
    let c = hash(b);
    let d = hash(c);
    let length = sqrt(-2.0 * log(vec2(unit(a), unit(c))));
    let turn = TAU * vec2(unit(b), unit(d));
    let normal = vec3(length.x * cos(turn.x), length.x * sin(turn.x), length.y * cos(turn.y));
    let opacity = 1.0 / (1.0 + exp(-opacity_logits[i]));
    let gain = params.strength / (1.0 + exp(min(100.0 * (opacity - 0.005), 80.0)));
    let scale = exp(vec3(log_scales[3u * i], log_scales[3u * i + 1u], log_scales[3u * i + 2u]));
    let axes = quaternion_matrix(normalize(rotations[i]));
    let step = gain * (axes * (scale * scale * (normal * axes)));
    for (var k = 0u; k < 3u; k++) {
        means[3u * i + k] += step[k];
    }
}
