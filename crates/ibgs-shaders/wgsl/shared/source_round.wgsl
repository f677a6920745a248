// Several sources of a pixel in one thread. The kernel declares `sources`, all sources' parameters, and the photos of a
// round, `photo0` and, after `#define FOUR`, to `photo3`.
#import source

/// A dispatch of the warping, which goes over some of the sources.
struct WarpParams {
    /// The target's size in pixels.
    size: vec2<u32>,
    /// Number of the first source.
    first: u32,
    /// Number of sources.
    count: u32,
    /// Visible sources a pixel, V.
    visible: u32,
    /// Median intersections a pixel.
    intersections: u32,
    /// The depths of source and point agree when they differ by less than this part of the latter.
    agreement: f32,
    /// A source is packed when they differ by less than this many times that: 1, or up to 5 where a confidence weighs
    /// the sources.
    reach: f32,
}

var<immediate> warping: WarpParams;

// The source that the thread is at, and its place in the round.
var<private> params: SourceParams;
var<private> slot: u32;

fn take_source(s: u32) {
    slot = s;
    params = sources[warping.first + s];
}

// Texels of the source's photo at a landing: top left, top right, and those under them.
fn texels(l: Landing) -> vec4<u32> {
    let at = l.texel;
    let below = at + params.source_size.x;
#if FOUR
    switch slot {
        #repeat s 3
        case $su: {
            return vec4(photo$s[at], photo$s[at + 1u], photo$s[below], photo$s[below + 1u]);
        }
        #end
        default: {
            return vec4(photo3[at], photo3[at + 1u], photo3[below], photo3[below + 1u]);
        }
    }
#else
    return vec4(photo0[at], photo0[at + 1u], photo0[below], photo0[below + 1u]);
#endif
}
