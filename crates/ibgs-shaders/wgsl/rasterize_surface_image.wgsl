#set render
#stage blend
// As rasterize_surface, without the list entries that gradients need, and with one buffer for normals and transmittance: eight are
// all that WebGPU promises.
#define COLOR
#define PLANES
#define INTERSECTIONS
#define TRANSMITTANCE_BEHIND
#import surface
#import tile

@group(0) @binding(0) var<storage, read> projected: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> planes: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> sorted_gaussians: array<u32>;
@group(0) @binding(3) var<storage, read> tile_ranges: array<u32>;
@group(0) @binding(4) var<storage, read_write> image: array<f32>;
/// Sum of w n_c, three values a pixel; behind them the transmittance.
@group(0) @binding(5) var<storage, read_write> normal_map: array<f32>;
@group(0) @binding(6) var<storage, read_write> median_depth: array<f32>;
/// K planes of (view depth, weight), front to back; weight 0 = empty.
@group(0) @binding(7) var<storage, read_write> intersections: array<vec2<f32>>;

#kernel rasterize_surface_image
//! Alpha blending with normal map, at most four median intersections and median depth, without what gradients need.
#import blend

#kernel rasterize_surface_image_deep
//! The same with at most eight median intersections.
#define DEEP
#import blend
