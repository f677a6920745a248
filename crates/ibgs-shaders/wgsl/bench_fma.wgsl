//! Multiply-adds in registers.
#set train
#stage other
// Multiply-adds in registers, BENCH_FMAS a step, in 16 chains that do not wait for each other: how fast the device computes.
#import index

/// Multiply-adds in registers.
struct FmaParams {
    /// Threads.
    count: u32,
    /// Steps of [`crate::BENCH_FMAS`] multiply-adds.
    steps: u32,
}

var<immediate> params: FmaParams;

/// In memory, so that the compiler cannot know them.
@group(0) @binding(0) var<storage, read> factor_and_summand: array<f32>;
@group(0) @binding(1) var<storage, read_write> sums: array<f32>;

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
    let x = vec4(factor_and_summand[0]);
    let y = vec4(factor_and_summand[1]);
    var a = vec4(f32(i), f32(i) + 0.25, f32(i) + 0.5, f32(i) + 0.75);
    var b = a + 1.0;
    var c = a + 2.0;
    var d = a + 3.0;
    for (var step = 0u; step < params.steps; step++) {
        for (var k = 0u; k < BENCH_FMAS / 16u; k++) {
            a = fma(x, a, y);
            b = fma(x, b, y);
            c = fma(x, c, y);
            d = fma(x, d, y);
        }
    }
    sums[i] = dot(a + b + c + d, vec4(1.0));
}
