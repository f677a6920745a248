// Linear index of a workgroup in a dispatch that was folded into two dimensions.
fn linear_workgroup(wid: vec3<u32>, groups: vec3<u32>) -> u32 {
    return wid.x + wid.y * groups.x;
}
