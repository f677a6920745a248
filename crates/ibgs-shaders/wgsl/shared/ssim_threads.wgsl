// For devices of many lanes: a workgroup has a tile. First the window is summed along the rows of the tile with its halo, by each thread
// four neighbours in a row, for which it reads 14 values in place of 44. Then along the columns: each thread completes two pixels, one
// above the other. Sums along rows take the place of what they are of, so that more workgroups fit.

const THREADS: u32 = TILE * TILE / 2u;
// Each thread reads six pixels of the tile with its halo, at once: drivers do not move the reads of a loop's next step before those of
// this one.
const_assert SIDE * SIDE <= 6u * THREADS;
// From a row of the tile with its halo to the next: odd, so that rows begin in different banks of workgroup memory.
const PITCH: u32 = SIDE + 1u;
const_assert SIDE * TILE / 4u <= THREADS;
// The sums along the rows: all even rows, a gap for the banks, all odd rows. Then what the two rows of threads of a subgroup read lies
// side by side. Column 4 q + k of a row is at 4 k + q.
const ODD_ROWS: u32 = SIDE * TILE / 2u + 4u;
const ROW_SUMS: u32 = SIDE * TILE + 4u;
const_assert ROW_SUMS <= PITCH * SIDE;

// Index of pixel `tile origin + offset - RADIUS`, or -1 outside the image.
fn halo_pixel(tile: vec2<u32>, k: u32) -> i32 {
    let at = vec2<i32>(tile * TILE + vec2(k % SIDE, k / SIDE)) - i32(RADIUS);
    if any(at < vec2(0)) || any(at >= vec2<i32>(params.size)) {
        return -1;
    }
    return at.y * i32(params.size.x) + at.x;
}

// Its place in workgroup memory.
fn halo_place(k: u32) -> u32 {
    return k / SIDE * PITCH + k % SIDE;
}

// Whether the thread sums along a row.
fn has_row(local: u32) -> bool {
    return local < SIDE * TILE / 4u;
}

// Place of the first of the values that it sums.
fn row_place(local: u32) -> u32 {
    return local / 4u * PITCH + local % 4u * 4u;
}

// Place of the first of its sums; the others are four apart.
fn row_sum_place(local: u32) -> u32 {
    let row = local / 4u;
    return row % 2u * ODD_ROWS + row / 2u * TILE + local % 4u;
}

// The upper one of the thread's pixels.
fn upper_pixel(tile: vec2<u32>, local: u32) -> vec2<u32> {
    return tile * TILE + vec2(local % 4u * 4u + local % TILE / 4u, local / TILE * 2u);
}
