// The shift registers of the median intersections, newest last, when a number comes in. DEEP: all four of them are wanted, else the
// last two; what stays constant takes no registers.
fn pushed(kept: vec4<f32>, number: f32) -> vec4<f32> {
    #if DEEP
    return vec4(kept.yzw, number);
    #else
    return vec4(0.0, 0.0, kept.w, number);
    #endif
}

fn pushed_entry(kept: vec4<u32>, entry: u32) -> vec4<u32> {
    #if DEEP
    return vec4(kept.yzw, entry);
    #else
    return vec4(NO_ENTRY, NO_ENTRY, kept.w, entry);
    #endif
}
