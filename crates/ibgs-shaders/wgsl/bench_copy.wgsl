//! A copy of a large buffer.
#set train
#stage other
// One thread a vec4: a copy, to measure how fast memory is read and written.
#import count_params
#import index

@group(0) @binding(0) var<storage, read> values: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read_write> copied: array<vec4<f32>>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_workgroup(wid, groups) * 256u + local;
    if i < params.count {
        copied[i] = values[i];
    }
}
