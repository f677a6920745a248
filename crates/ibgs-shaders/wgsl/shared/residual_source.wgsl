// How a convolution of the residual network reads its input: as it is, through a 2 x 2 maximum, or enlarged.

// The input has the size of the output.
const SAME: u32 = 0u;
// The input is the maximum of 2 x 2 of the source (an odd last row or column is left out).
const POOLED: u32 = 1u;
// The input is the nearest of a smaller source: source = floor(target * source size / target size).
const NEAREST: u32 = 2u;

// Source coordinate of coordinate `at` in an input of length `size`, or -1 outside of it: zero padding.
fn source_of(at: i32, size: u32, source: u32, mode: u32) -> i32 {
    if at < 0 || at >= i32(size) {
        return -1;
    }
    if mode == POOLED {
        return 2 * at;
    }
    if mode == NEAREST {
        return i32(u32(at) * source / size);
    }
    return at;
}
