//! Alpha blending.
#set render
#stage blend
// Front-to-back alpha blending of the colour (method.md section 2).
#define COLOR
#define ENTRIES
#import frame
#import tile

@group(0) @binding(0) var<storage, read> projected: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> sorted_gaussians: array<u32>;
@group(0) @binding(2) var<storage, read> tile_ranges: array<u32>;
@group(0) @binding(3) var<storage, read_write> image: array<f32>;
/// Transmittance behind the last contributor.
@group(0) @binding(4) var<storage, read_write> final_t: array<f32>;
/// How many list entries of the tile were walked up to it.
@group(0) @binding(5) var<storage, read_write> last_entry: array<u32>;

#import blend
