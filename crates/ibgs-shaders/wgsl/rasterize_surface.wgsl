#set train
#stage blend
// Front-to-back alpha blending of the colour (method.md section 2), and beside it the normal map, the K median intersections and
// the median depth (section 3).
#define COLOR
#define PLANES
#define INTERSECTIONS
#define ENTRIES
#import surface
#import tile

@group(0) @binding(0) var<storage, read> projected: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> planes: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> sorted_gaussians: array<u32>;
@group(0) @binding(3) var<storage, read> tile_ranges: array<u32>;
@group(0) @binding(4) var<storage, read_write> image: array<f32>;
@group(0) @binding(5) var<storage, read_write> final_t: array<f32>;
@group(0) @binding(6) var<storage, read_write> last_entry: array<u32>;
/// Sum of w n_c, three values a pixel.
@group(0) @binding(7) var<storage, read_write> normal_map: array<f32>;
@group(0) @binding(8) var<storage, read_write> median_depth: array<f32>;
/// K planes of (view depth, weight), front to back; weight 0 = empty.
@group(0) @binding(9) var<storage, read_write> intersections: array<vec2<f32>>;
/// Their entries in the tile's list.
@group(0) @binding(10) var<storage, read_write> intersection_entries: array<u32>;

#kernel rasterize_surface
//! Alpha blending with normal map, at most four median intersections and median depth.
#import blend

#kernel rasterize_surface_deep
//! Alpha blending with normal map, at most eight median intersections and median depth.
#define DEEP
#import blend
