//! Smoothed differences of a photo from what is rendered and what is warped, in cells.
#set train
#stage other
// One thread a cell of side x side pixels, which adds its pixels up row by row; cells at the right and the lower edge may be cut.
// A pixel takes part where the photo has it, also where the learned mask hides it: the mask must be able to open again.
#import photo
#import seen
#import index

/// A photo in cells.
struct TransientParams {
    /// Width and height in pixels.
    size: vec2<u32>,
    /// Cells in a row and in a column.
    cells: vec2<u32>,
    /// Side of a cell in pixels.
    side: u32,
    /// Visible sources of a pixel; 0: nothing is warped.
    visible: u32,
    /// Part of the evidence that this visit replaces.
    rate: f32,
    /// Nothing.
    padding: u32,
}

@group(0) @binding(0) var<storage, read> photo: array<u32>;
/// In the photo's exposure.
@group(0) @binding(1) var<storage, read> image: array<f32>;
/// [V, P, 4]: colour and cosine.
@group(0) @binding(2) var<storage, read> warped: array<f32>;
@group(0) @binding(3) var<storage, read> seen: array<u32>;
/// Three rows a cell, sums over visits with their weight in w: mean of photo - image; mean of photo - mean of the sources that
/// agree; mean of |photo - image|, detail of the photo, detail of the image.
@group(0) @binding(4) var<storage, read_write> evidence: array<vec4<f32>>;

var<immediate> params: TransientParams;

fn photo_color(p: u32) -> vec3<f32> {
    let texel = photo[p];
    return vec3(photo_channel(texel, 0u), photo_channel(texel, 1u), photo_channel(texel, 2u));
}

fn image_color(p: u32) -> vec3<f32> {
    return vec3(image[3u * p], image[3u * p + 1u], image[3u * p + 2u]);
}

fn size_of(v: vec3<f32>) -> f32 {
    return (abs(v.x) + abs(v.y) + abs(v.z)) / 3.0;
}

// How much a pixel differs from another one, in the photo and in the image.
fn steps(p: u32, other: u32) -> vec2<f32> {
    return vec2(size_of(photo_color(p) - photo_color(other)), size_of(image_color(p) - image_color(other)));
}

// The mean of the sources that agree at a pixel, and 1; 0 where none does.
fn mean_of_sources(p: u32) -> vec4<f32> {
    var total = vec4(0.0);
    for (var m = 0u; m < params.visible; m++) {
        if is_seen(seen[p], m) && seen_agrees(seen[p], m) {
            let at = 4u * (m * params.size.x * params.size.y + p);
            total += vec4(warped[at], warped[at + 1u], warped[at + 2u], 1.0);
        }
    }
    return total / max(total.w, 1.0);
}

fn smoothed(at: u32, value: vec4<f32>) {
    evidence[at] = mix(evidence[at], value, params.rate);
}

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let cell = linear_workgroup(wid, groups) * 256u + local;
    if cell >= params.cells.x * params.cells.y {
        return;
    }
    let first = params.side * vec2(cell % params.cells.x, cell / params.cells.x);
    let end = min(first + params.side, params.size);
    var by_image = vec4(0.0);
    var by_sources = vec4(0.0);
    var error = 0.0;
    var detail = vec2(0.0);
    for (var y = first.y; y < end.y; y++) {
        for (var x = first.x; x < end.x; x++) {
            let p = y * params.size.x + x;
            if (photo[p] >> 24u) < ALPHA_HIDDEN {
                continue;
            }
            let color = photo_color(p);
            let difference = color - image_color(p);
            by_image += vec4(difference, 1.0);
            error += size_of(difference);
            if x + 1u < end.x {
                detail += steps(p, p + 1u);
            }
            if y + 1u < end.y {
                detail += steps(p, p + params.size.x);
            }
            let mean = mean_of_sources(p);
            by_sources += mean.w * vec4(color - mean.xyz, 1.0);
        }
    }
    if by_image.w > 0.0 {
        smoothed(3u * cell, by_image / by_image.w);
        smoothed(3u * cell + 2u, vec4(vec3(error, detail) / by_image.w, 1.0));
    }
    if 4.0 * by_sources.w >= by_image.w && by_sources.w > 0.0 {
        smoothed(3u * cell + 1u, by_sources / by_sources.w);
    }
}
