//! A part of a frame as 8-bit colours.
#set render
#stage other
// One thread a pixel: a part of a frame as 8-bit colours for the screen, as the pictures of the host show it. Rows are padded to
// `stride` pixels, as copies into textures ask for.
#import index

/// What is shown of a frame.
struct PresentParams {
    /// Width and height.
    size: vec2<u32>,
    /// Pixels from one row to the next.
    stride: u32,
    /// A [`crate::Presented`].
    mode: u32,
    /// Depth of the brightest and of the darkest colour.
    range: vec2<f32>,
    /// Number of sources that has the brightest colour.
    most: u32,
    /// Differences are amplified by this factor.
    gain: f32,
}

var<immediate> params: PresentParams;

@group(0) @binding(0) var<storage, read> values: array<f32>;
@group(0) @binding(1) var<storage, read> others: array<f32>;
@group(0) @binding(2) var<storage, read> words: array<u32>;
/// 256 colours, from dark to bright.
@group(0) @binding(3) var<storage, read> palette: array<u32>;
@group(0) @binding(4) var<storage, read_write> pixels: array<u32>;

fn rgb(color: vec3<f32>) -> u32 {
    return pack4x8unorm(vec4(color, 1.0));
}

fn in_palette(t: f32) -> u32 {
    return palette[u32(clamp(t, 0.0, 1.0) * 255.0 + 0.5)];
}

fn color(i: u32) -> vec3<f32> {
    return vec3(values[3u * i], values[3u * i + 1u], values[3u * i + 2u]);
}

fn count(word: u32) -> u32 {
    var n = 0u;
    for (var m = 0u; m < 4u; m++) {
        n += u32(((word >> (8u * m)) & 255u) != 255u);
    }
    return n;
}

fn shown(i: u32) -> u32 {
    switch params.mode {
        case PRESENT_RESIDUAL: {
            let other = vec3(others[3u * i], others[3u * i + 1u], others[3u * i + 2u]);
            return rgb(0.5 + params.gain * (color(i) - other));
        }
        case PRESENT_DEPTH: {
            let z = values[i];
            // Neither 0 nor infinite nor no number.
            if !(z > 0.0 && z < 3e38) {
                return rgb(vec3(0.0));
            }
            return in_palette(1.0 - (z - params.range.x) / max(params.range.y - params.range.x, 1e-30));
        }
        case PRESENT_NORMAL: {
            let n = color(i);
            let length = length(n);
            if !(length > 0.0 && length < 3e38) {
                return rgb(vec3(0.0));
            }
            return rgb(0.5 + 0.5 * vec3(n.x, -n.y, -n.z) / length);
        }
        case PRESENT_VISIBILITY: {
            let n = count(words[i]);
            if n == 0u {
                return rgb(vec3(0.0));
            }
            return in_palette(f32(n) / f32(params.most));
        }
        case PRESENT_DIFFERENCE: {
            return rgb(0.5 + params.gain * (color(i) - unpack4x8unorm(words[i]).rgb));
        }
        case PRESENT_PHOTO: {
            return words[i] | 0xff000000u;
        }
        case PRESENT_HIDDEN: {
            let texel = unpack4x8unorm(words[i]);
            // Losses and warps read what has an alpha of one half or more.
            if texel.a < 0.5 {
                return rgb(texel.rgb);
            }
            return rgb(vec3((texel.r + texel.g + texel.b) / 6.0));
        }
        default: {
            return rgb(color(i));
        }
    }
}

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_workgroup(wid, groups) * 256u + local;
    if i >= params.size.x * params.size.y {
        return;
    }
    pixels[(i / params.size.x) * params.stride + i % params.size.x] = shown(i);
}
