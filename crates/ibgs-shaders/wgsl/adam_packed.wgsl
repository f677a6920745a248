//! Adam with packed moments.
#set train
#stage adam
// One thread a word of moments: a step of its values. A row begins with a word. The step itself is made with moments that are
// not rounded yet.
#import index
#import hash
#import adam
#import packed_moments

@group(0) @binding(0) var<storage, read> gradient: array<f32>;
@group(0) @binding(1) var<storage, read_write> values: array<f32>;
@group(0) @binding(2) var<storage, read_write> moments: array<u32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let word = linear_workgroup(wid, groups) * 256u + local;
    let words = (params.row + MOMENTS_A_WORD - 1u) / MOMENTS_A_WORD;
    if word >= params.count / params.row * words {
        return;
    }
    let packed = moments[word];
    let first = word % words * MOMENTS_A_WORD;
    var random = hash(word ^ hash(params.step));
    var next = 0u;
    for (var k = 0u; k < MOMENTS_A_WORD && first + k < params.row; k++) {
        let i = word / words * params.row + first + k;
        let code = extractBits(packed, k * MOMENT_BITS, MOMENT_BITS);
        let m = adam_moments(unpack_moments(code), gradient[i]);
        values[i] = adam_value(values[i], first + k, m);
        next = insertBits(next, pack_moments(m, random), k * MOMENT_BITS, MOMENT_BITS);
        random = hash(random);
    }
    moments[word] = next;
}
