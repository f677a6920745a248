// How a convolution of the residual network reads its input: as it is, through a 2 x 2 maximum, or enlarged.

// Source coordinate of coordinate `at` in an input of length `size`, or -1 outside of it: zero padding.
fn source_of(at: i32, size: u32, source: u32, mode: u32) -> i32 {
    if at < 0 || at >= i32(size) {
        return -1;
    }
    if mode == CONV_POOLED {
        return 2 * at;
    }
    if mode == CONV_NEAREST {
        return i32(u32(at) * source / size);
    }
    return at;
}
