#stage warp
// One thread a pixel, a round of sources a dispatch, in order: reads a source's photo where the median intersections fall,
// decides by depth whether the source sees the pixel's point, and packs it (method.md section 5). Departs from the published
// code (method.md 10.5): the depth test decides.

/// All sources.
@group(0) @binding(0) var<storage, read> sources: array<SourceParams>;
@group(0) @binding(1) var<storage, read> median_depth: array<f32>;
/// K planes of (view depth, weight).
@group(0) @binding(2) var<storage, read> intersections: array<vec2<f32>>;
/// V planes of (r, g, b, cosine).
@group(0) @binding(3) var<storage, read_write> warped: array<vec4<f32>>;
/// One byte a visible source.
@group(0) @binding(4) var<storage, read_write> seen: array<u32>;
/// [0]: visible sources of the pixel that has most.
@group(0) @binding(5) var<storage, read_write> most_visible: array<atomic<u32>>;
/// RGBA8; a read that touches a texel with alpha under one half does not count.
@group(0) @binding(6) var<storage, read> photo0: array<u32>;
/// The source's own median depth.
@group(0) @binding(7) var<storage, read> source_depth0: array<f32>;

#kernel warp
//! Colours of one source photo at the median intersections, visibility, packing.
#set render
#import warp_round

#kernel warp_four
//! The same of up to four source photos, for devices that bind more buffers than a browser promises.
#set train
#define FOUR
/// The second source of the round; where there is none any photo.
@group(0) @binding(8) var<storage, read> photo1: array<u32>;
/// Its median depth.
@group(0) @binding(9) var<storage, read> source_depth1: array<f32>;
/// The third.
@group(0) @binding(10) var<storage, read> photo2: array<u32>;
/// Its median depth.
@group(0) @binding(11) var<storage, read> source_depth2: array<f32>;
/// The fourth.
@group(0) @binding(12) var<storage, read> photo3: array<u32>;
/// Its median depth.
@group(0) @binding(13) var<storage, read> source_depth3: array<f32>;
#import warp_round
