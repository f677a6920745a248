// Visible sources of a pixel in one word (method.md section 5): byte m has the number of the m-th source in its low
// half and the error of its depth in its high half, in thirds of the largest error that agrees (0 where only agreeing
// sources are packed); 255 where there is none.

// Thirds of the depth agreement.
const ERROR_STEPS: u32 = 3u;
const MOST_ERROR: u32 = 14u;

fn seen_byte(packed: u32, m: u32) -> u32 {
    return (packed >> (8u * m)) & 255u;
}

fn is_seen(packed: u32, m: u32) -> bool {
    return seen_byte(packed, m) != 255u;
}

// Number of the m-th visible source.
fn seen_source(packed: u32, m: u32) -> u32 {
    return seen_byte(packed, m) & 15u;
}

fn seen_error(packed: u32, m: u32) -> u32 {
    return seen_byte(packed, m) >> 4u;
}

// The error of its depth as a part of what agrees.
fn relative_error(packed: u32, m: u32) -> f32 {
    return f32(seen_error(packed, m)) / f32(ERROR_STEPS);
}

// Whether the source's depth agrees with the point's.
fn seen_agrees(packed: u32, m: u32) -> bool {
    return seen_error(packed, m) < ERROR_STEPS;
}
