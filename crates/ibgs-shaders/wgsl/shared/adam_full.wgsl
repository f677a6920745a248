// One thread a value: a step with both moments in float32.
#import index
#import adam

@group(0) @binding(2) var<storage, read_write> moment1: array<f32>;
@group(0) @binding(3) var<storage, read_write> moment2: array<f32>;
#if HARMONICS
@group(0) @binding(4) var<storage, read> means: array<f32>;
#endif

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
    let column = i % params.row;
    let m = adam_moments(vec2(moment1[i], moment2[i]), adam_gradient(i / params.row, column));
    moment1[i] = m.x;
    moment2[i] = m.y;
    values[i] = adam_value(values[i], column, m);
}
