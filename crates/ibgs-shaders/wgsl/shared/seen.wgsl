// Packed slots of a pixel (method.md section 5): byte m is the number of the source in slot m, 255 where it is empty.
fn slot_source(packed: u32, slot: u32) -> u32 {
    return (packed >> (8u * slot)) & 255u;
}

fn slot_filled(packed: u32, slot: u32) -> bool {
    return slot_source(packed, slot) != 255u;
}
