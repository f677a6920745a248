#set train
// A photo's cells, CELL x CELL pixels each, row by row; those at the right and the lower edge may be cut. A pixel takes part where
// the photo has it, also where the learned mask hides it: the mask must be able to open again.
#import photo
#import index

/// A photo in cells.
struct TransientParams {
    /// Width and height in pixels.
    size: vec2<u32>,
    /// Cells in a row and in a column.
    cells: vec2<u32>,
    /// Visible sources of a pixel; 0: nothing is warped.
    visible: u32,
    /// 1: the photo has just been uploaded, and its alpha is still its own.
    fresh: u32,
}

var<immediate> params: TransientParams;

#kernel transient_cells
//! Differences of a photo from what is rendered and what is warped, in cells.
#stage other
// One thread a cell, which adds its pixels up row by row.
#import seen

@group(0) @binding(0) var<storage, read> photo: array<u32>;
/// In the photo's exposure.
@group(0) @binding(1) var<storage, read> image: array<f32>;
/// [V, P, 4]: colour and cosine.
@group(0) @binding(2) var<storage, read> warped: array<f32>;
@group(0) @binding(3) var<storage, read> seen: array<u32>;
/// Two rows a cell: the sum of photo - image and the pixels of it, the sum of photo - mean of the sources that agree and the pixels
/// that have any.
@group(0) @binding(4) var<storage, read_write> sums: array<vec4<f32>>;

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
    let first = CELL * vec2(cell % params.cells.x, cell / params.cells.x);
    let end = min(first + CELL, params.size);
    let plane = params.size.x * params.size.y;
    var by_image = vec4(0.0);
    var by_sources = vec4(0.0);
    for (var y = first.y; y < end.y; y++) {
        for (var x = first.x; x < end.x; x++) {
            let p = y * params.size.x + x;
            let texel = photo[p];
            if (texel >> 24u) < ALPHA_HIDDEN {
                continue;
            }
            let color = vec3(photo_channel(texel, 0u), photo_channel(texel, 1u), photo_channel(texel, 2u));
            by_image += vec4(color - vec3(image[3u * p], image[3u * p + 1u], image[3u * p + 2u]), 1.0);
            var total = vec4(0.0);
            for (var m = 0u; m < params.visible; m++) {
                if is_seen(seen[p], m) && seen_agrees(seen[p], m) {
                    let at = 4u * (m * plane + p);
                    total += vec4(warped[at], warped[at + 1u], warped[at + 2u], 1.0);
                }
            }
            if total.w > 0.0 {
                by_sources += vec4(color - total.xyz / total.w, 1.0);
            }
        }
    }
    sums[2u * cell] = by_image;
    sums[2u * cell + 1u] = by_sources;
}

#kernel transient_mask
//! A learned mask in the alpha of a photo.
#stage other
// One thread a pixel. Alpha becomes 0 where the photo has no pixel, ALPHA_HIDDEN where the mask hides it, else 255.

/// A word a cell: 1 hides it.
@group(0) @binding(0) var<storage, read> mask: array<u32>;
@group(0) @binding(1) var<storage, read_write> photo: array<u32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let p = linear_workgroup(wid, groups) * 256u + local;
    if p >= params.size.x * params.size.y {
        return;
    }
    let texel = photo[p];
    let has = photo_valid(texel) || (params.fresh == 0u && (texel >> 24u) == ALPHA_HIDDEN);
    let cell = vec2(p % params.size.x, p / params.size.x) / CELL;
    let hidden = mask[cell.y * params.cells.x + cell.x] != 0u;
    let alpha = select(0u, select(255u, ALPHA_HIDDEN, hidden), has);
    photo[p] = (texel & 0xffffffu) | (alpha << 24u);
}
