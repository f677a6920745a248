//! Gradient by the exposure.
#set train
#stage other
// One workgroup: gradient by a photo's exposure from the workgroups' sums, with that of a pull towards none, so that the photos'
// exposures have a mean that stays.
#import reduce

@group(0) @binding(0) var<storage, read> exposures: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> partials: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> v_exposure: array<vec4<f32>>;

const THREADS: u32 = EXPOSURE_GROUPS;

@compute @workgroup_size(THREADS)
fn main(@builtin(local_invocation_index) local: u32) {
    let by_gain = reduce(local, partials[2u * local]);
    let by_offset = reduce(local, partials[2u * local + 1u]);
    if local == 0u {
        v_exposure[0] = by_gain + EXPOSURE_PULL * exposures[0];
        v_exposure[1] = by_offset + EXPOSURE_PULL * exposures[1];
    }
}
