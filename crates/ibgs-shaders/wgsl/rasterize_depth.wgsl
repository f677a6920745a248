#set render
#stage depth maps of the sources
// The median depth alone (method.md section 3).
#define PLANES
#import surface
#import tile

@group(0) @binding(0) var<storage, read> projected: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> planes: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> sorted_gaussians: array<u32>;
@group(0) @binding(3) var<storage, read> tile_ranges: array<u32>;
@group(0) @binding(4) var<storage, read_write> median_depth: array<f32>;

#kernel rasterize_depth
//! Median depth alone, of at most four median intersections.
#import blend

#kernel rasterize_depth_deep
//! Median depth alone, of at most eight median intersections.
#define DEEP
#import blend
