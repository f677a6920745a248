// Packed slots of a pixel (method.md section 5): byte m has the number of the source in slot m in its low half and in its high half how
// far the source's depth is from the point's, in thirds of what agrees (0 where only such are packed); 255 where the slot is empty.

// Thirds of the depth agreement.
const ERROR_STEPS: u32 = 3u;
const MOST_ERROR: u32 = 14u;

fn slot_byte(packed: u32, slot: u32) -> u32 {
    return (packed >> (8u * slot)) & 255u;
}

fn slot_filled(packed: u32, slot: u32) -> bool {
    return slot_byte(packed, slot) != 255u;
}

// Number of the source in a filled slot.
fn slot_source(packed: u32, slot: u32) -> u32 {
    return slot_byte(packed, slot) & 15u;
}

fn slot_error(packed: u32, slot: u32) -> u32 {
    return slot_byte(packed, slot) >> 4u;
}

// Whether the source's depth agrees with the point's.
fn slot_agrees(packed: u32, slot: u32) -> bool {
    return slot_error(packed, slot) < ERROR_STEPS;
}
