//! Depth of each pixel by comparing photos on planes.
#set train
#stage other
// One thread a pixel: the plane, parallel to the image, on which the photos of other views agree best with the pixel's
// surroundings (plane sweep: Collins, 1996). A source's score on a plane is the correlation of 5 x 5 brightnesses, normalised by mean
// and variance; the pixel's score is the mean of the best three sources. Planes are even in inverse depth.
#import photo

/// A plane sweep.
struct SweepParams {
    /// Image size in pixels.
    size: vec2<u32>,
    /// Number of planes, at least 2.
    planes: u32,
    /// Number of sources.
    sources: u32,
    /// Focal lengths in pixels.
    focal: vec2<f32>,
    /// Principal point minus one half: the pixel with index x lies at x.
    principal: vec2<f32>,
    /// Inverse depth of the first plane.
    nearest: f32,
    /// Inverse depth of the last plane, above 0.
    farthest: f32,
    /// Padding.
    pad: vec2<u32>,
}

/// A source of a plane sweep, in a buffer.
struct SweepSource {
    /// Rows of [R | t] with `x_source = R x_target + t`.
    rows: array<vec4<f32>, 3>,
    /// Focal lengths in pixels.
    focal: vec2<f32>,
    /// Principal point minus one half.
    principal: vec2<f32>,
    /// Photo size in pixels, at least 2 each.
    size: vec2<u32>,
    /// First texel of its photo among all.
    offset: u32,
    /// Padding.
    pad: u32,
}

var<immediate> params: SweepParams;

/// The target's photo, then those of the sources.
@group(0) @binding(0) var<storage, read> photos: array<u32>;
@group(0) @binding(1) var<storage, read> sources: array<SweepSource>;
/// (view depth, score); the score is under 0 where nothing was found.
@group(0) @binding(2) var<storage, read_write> found: array<vec2<f32>>;

const RADIUS: i32 = 2;
const TAPS: u32 = 25u;
// Least variance of the brightnesses, 1 is white: with less there is nothing to compare.
const LEAST_VARIANCE: f32 = 2e-5;
const NOTHING: f32 = -1.0;

fn brightness(texel: u32) -> f32 {
    return dot(unpack4x8unorm(texel).rgb, vec3(0.299, 0.587, 0.114));
}

struct Read {
    value: f32,
    is_valid: bool,
}

fn read_source(source: SweepSource, at: vec2<f32>) -> Read {
    let last = vec2<f32>(source.size) - 1.0;
    if !(all(at >= vec2(0.0)) && all(at <= last)) {
        return Read(0.0, false);
    }
    let first = min(vec2<u32>(at), source.size - 2u);
    let fraction = at - vec2<f32>(first);
    let texel = source.offset + first.y * source.size.x + first.x;
    let t00 = photos[texel];
    let t10 = photos[texel + 1u];
    let t01 = photos[texel + source.size.x];
    let t11 = photos[texel + source.size.x + 1u];
    let upper = mix(brightness(t00), brightness(t10), fraction.x);
    let lower = mix(brightness(t01), brightness(t11), fraction.x);
    return Read(mix(upper, lower, fraction.y), photo_valid(t00 & t10 & t01 & t11));
}

// Correlation with a source on the plane at this depth; NOTHING where the source does not show all of the surroundings.
fn correlation(index: u32, pixel: vec2<u32>, depth: f32, own: ptr<function, array<f32, 25>>, deviation: f32) -> f32 {
    let source = sources[index];
    var sums = vec3(0.0);
    for (var tap = 0u; tap < TAPS; tap++) {
        let offset = vec2(i32(tap % 5u), i32(tap / 5u)) - RADIUS;
        let ray = vec3((vec2<f32>(vec2<i32>(pixel) + offset) - params.principal) / params.focal, 1.0) * depth;
        let point = vec3(dot(source.rows[0].xyz, ray), dot(source.rows[1].xyz, ray), dot(source.rows[2].xyz, ray))
            + vec3(source.rows[0].w, source.rows[1].w, source.rows[2].w);
        if point.z <= 0.0 {
            return NOTHING;
        }
        let read = read_source(source, source.focal * point.xy / point.z + source.principal);
        if !read.is_valid {
            return NOTHING;
        }
        sums += vec3(read.value, read.value * read.value, read.value * (*own)[tap]);
    }
    let mean = sums.x / f32(TAPS);
    let variance = sums.y / f32(TAPS) - mean * mean;
    if variance < LEAST_VARIANCE {
        return NOTHING;
    }
    // The mean of `own` is 0.
    return sums.z / (f32(TAPS) * sqrt(variance) * deviation);
}

@compute @workgroup_size(TILE, TILE)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= params.size) {
        return;
    }
    let p = id.y * params.size.x + id.x;
    found[p] = vec2(0.0, NOTHING);
    let reach = vec2(u32(RADIUS));
    if any(id.xy < reach) || any(id.xy + reach >= params.size) {
        return;
    }
    var own: array<f32, 25>;
    var mean = 0.0;
    for (var tap = 0u; tap < TAPS; tap++) {
        let at = vec2<u32>(vec2<i32>(id.xy) + vec2(i32(tap % 5u), i32(tap / 5u)) - RADIUS);
        let texel = photos[at.y * params.size.x + at.x];
        if !photo_valid(texel) {
            return;
        }
        own[tap] = brightness(texel);
        mean += own[tap] / f32(TAPS);
    }
    var variance = 0.0;
    for (var tap = 0u; tap < TAPS; tap++) {
        own[tap] -= mean;
        variance += own[tap] * own[tap] / f32(TAPS);
    }
    if variance < LEAST_VARIANCE {
        return;
    }
    let deviation = sqrt(variance);
    let step = (params.farthest - params.nearest) / f32(params.planes - 1u);
    var best = NOTHING;
    var best_plane = 0u;
    // Scores of the planes before and after the best one, and of the last plane.
    var around = vec2(NOTHING);
    var last = NOTHING;
    for (var plane = 0u; plane < params.planes; plane++) {
        let depth = 1.0 / (params.nearest + step * f32(plane));
        var three = vec3(NOTHING);
        for (var index = 0u; index < params.sources; index++) {
            let score = correlation(index, id.xy, depth, &own, deviation);
            if score > three.x {
                three = vec3(score, three.xy);
            } else if score > three.y {
                three = vec3(three.x, score, three.y);
            } else if score > three.z {
                three.z = score;
            }
        }
        // At least two must show it.
        var score = NOTHING;
        if three.z > NOTHING {
            score = (three.x + three.y + three.z) / 3.0;
        } else if three.y > NOTHING {
            score = 0.5 * (three.x + three.y);
        }
        if score > best {
            best = score;
            best_plane = plane;
            around = vec2(last, NOTHING);
        } else if plane == best_plane + 1u {
            around.y = score;
        }
        last = score;
    }
    if best == NOTHING {
        return;
    }
    // Between planes: the top of the parabola through three scores.
    var offset = 0.0;
    let bend = around.x + around.y - 2.0 * best;
    if min(around.x, around.y) > NOTHING && bend < 0.0 {
        offset = clamp(0.5 * (around.x - around.y) / bend, -0.5, 0.5);
    }
    found[p] = vec2(1.0 / (params.nearest + step * (f32(best_plane) + offset)), best);
}
