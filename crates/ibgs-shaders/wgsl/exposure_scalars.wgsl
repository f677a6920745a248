// One workgroup: gradient by the exposure scalars (a, b) from the workgroups' sums.
#import reduce

@group(0) @binding(0) var<storage, read> partials: array<vec2<f32>>;
@group(0) @binding(1) var<storage, read_write> v_scalars: array<f32>;

@compute @workgroup_size(EXPOSURE_GROUPS)
fn main(@builtin(local_invocation_index) local: u32) {
    let total = reduce(local, vec4(partials[local], 0.0, 0.0));
    if local == 0u {
        v_scalars[0] = total.x;
        v_scalars[1] = total.y;
    }
}
