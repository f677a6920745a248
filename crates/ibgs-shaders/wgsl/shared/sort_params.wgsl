struct SortParams {
    // First bit of this pass's digit.
    shift: u32,
    // Blocks of SORT_BLOCK keys in the dispatch: the row length of the digit-major histogram.
    blocks: u32,
    // Keys the buffers hold; the live number is min(count[0], capacity).
    capacity: u32,
    // 1: this pass's values are the keys' own positions, the value input is not read.
    first: u32,
}

var<immediate> params: SortParams;

fn digit_of(key: u32) -> u32 {
    return (key >> params.shift) & (SORT_BINS - 1u);
}
