// A fixed number of workgroups, each over its share of the pixels that see a source (or of the valid pixels of the target's
// photo): count and sums of base colour x and the other colour y, then sums of products about the workgroup's own means. About
// those means nothing cancels, however flat the picture.
#import photo
#import reduce
#import seen

struct ExposureSumsParams {
    pixels: u32,
    // Packed slots V.
    slots: u32,
    // Number of the source, 255: the target's photo.
    other: u32,
}

var<immediate> params: ExposureSumsParams;

@group(0) @binding(0) var<storage, read> base: array<f32>;
// [V, P, 4].
@group(0) @binding(1) var<storage, read> warped: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> seen: array<u32>;
// RGBA8 of the target.
@group(0) @binding(3) var<storage, read> photo: array<u32>;
// Rows of seven, the moments of exposure_solve.
@group(0) @binding(4) var<storage, read_write> partials: array<vec4<f32>>;

// The colour beside the base's and 1, or zero where there is none.
fn other_color(p: u32) -> vec4<f32> {
    if params.other == 255u {
        let texel = photo[p];
        if photo_valid(texel) {
            return vec4(unpack4x8unorm(texel).rgb, 1.0);
        }
        return vec4(0.0);
    }
    let packed = seen[p];
    for (var m = 0u; m < params.slots; m++) {
        if slot_source(packed, m) == params.other {
            return vec4(warped[m * params.pixels + p].rgb, 1.0);
        }
    }
    return vec4(0.0);
}

fn base_color(p: u32) -> vec3<f32> {
    return vec3(base[3u * p], base[3u * p + 1u], base[3u * p + 2u]);
}

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let first = wid.x * 256u + local;
    let stride = EXPOSURE_GROUPS * 256u;
    var sum_x = vec4(0.0);
    var sum_y = vec4(0.0);
    for (var p = first; p < params.pixels; p += stride) {
        let other = other_color(p);
        if other.w > 0.0 {
            sum_x += vec4(base_color(p), 1.0);
            sum_y += other;
        }
    }
    let total_x = reduce(local, sum_x);
    let total_y = reduce(local, sum_y);
    let count = max(total_x.w, 1.0);
    let mean_x = total_x.xyz / count;
    let mean_y = total_y.xyz / count;
    var xx = vec4(0.0);
    var yz = vec4(0.0);
    var by_red = vec4(0.0);
    var by_green = vec4(0.0);
    var by_blue = vec4(0.0);
    for (var p = first; p < params.pixels; p += stride) {
        let other = other_color(p);
        if other.w > 0.0 {
            let d = base_color(p) - mean_x;
            let e = other.xyz - mean_y;
            xx += vec4(d.x * d, d.y * d.y);
            yz += vec4(d.y * d.z, d.z * d.z, 0.0, 0.0);
            by_red += vec4(e.x * d, 0.0);
            by_green += vec4(e.y * d, 0.0);
            by_blue += vec4(e.z * d, 0.0);
        }
    }
    let moments = array<vec4<f32>, 5>(
        reduce(local, xx), reduce(local, yz), reduce(local, by_red), reduce(local, by_green), reduce(local, by_blue),
    );
    if local == 0u {
        let row = 7u * wid.x;
        partials[row] = total_x;
        partials[row + 1u] = total_y;
        for (var i = 0u; i < 5u; i++) {
            partials[row + 2u + i] = moments[i];
        }
    }
}
