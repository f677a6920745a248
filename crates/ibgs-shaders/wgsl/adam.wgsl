//! Adam.
#set train
#stage adam
// One thread a value: a step with both moments in float32.
#import index
#import adam

@group(0) @binding(0) var<storage, read> gradient: array<f32>;
@group(0) @binding(1) var<storage, read_write> values: array<f32>;
@group(0) @binding(2) var<storage, read_write> moment1: array<f32>;
@group(0) @binding(3) var<storage, read_write> moment2: array<f32>;

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
    let m = adam_moments(vec2(moment1[i], moment2[i]), gradient[i]);
    moment1[i] = m.x;
    moment2[i] = m.y;
    values[i] = adam_value(values[i], i % params.row, m);
}
