// How the U-Net's activations lie in memory: planes of float32, [channel][row][column]. With PACKED a word has the halves of two
// channels, [channel / 2][row][column]; the arithmetic stays float32.
#if PACKED
// Channels of a number in memory.
const CHANNELS: u32 = 2u;

// Halves are converted by hand: some drivers lack the built-in functions. What is smaller than 2^-14 may become zero, and what is
// out of range becomes the largest half.
const HALF_MAX: f32 = 65504.0;

// The number of a channel in its word.
fn number(word: u32, channel: u32) -> f32 {
    let high = word << (16u * (1u - channel % 2u));
    return 0x1p112 * bitcast<f32>((high & 0x80000000u) | ((high >> 3u) & 0x0fffe000u));
}

// The word of two channels. A number in the middle of two halves becomes the even one.
fn word(first: f32, second: f32) -> u32 {
    let v = bitcast<vec2<u32>>(0x1p-112 * clamp(vec2(first, second), vec2(-HALF_MAX), vec2(HALF_MAX)));
    let rounded = (v & vec2(0x7fffffffu)) + 0x0fffu + ((v >> vec2(13u)) & vec2(1u));
    let halves = (rounded >> vec2(13u)) | ((v >> vec2(16u)) & vec2(0x8000u));
    return halves.x | (halves.y << 16u);
}
#else
const CHANNELS: u32 = 1u;

fn number(value: f32, channel: u32) -> f32 {
    return value;
}
#endif
