//! Gradient of the blending by the projected quantities, a row an intersection.
#set train
#stage blend backward
// Gradient of rasterize.wgsl by the projected Gaussians.
#import frame
#import tile

@group(0) @binding(0) var<storage, read> projected: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> sorted_gaussians: array<u32>;
@group(0) @binding(2) var<storage, read> sorted_isects: array<u32>;
@group(0) @binding(3) var<storage, read> tile_ranges: array<u32>;
@group(0) @binding(4) var<storage, read> final_t: array<f32>;
@group(0) @binding(5) var<storage, read> last_entry: array<u32>;
@group(0) @binding(6) var<storage, read> v_image: array<f32>;
/// (r, g, b, opacity), a row an intersection, as in the next two.
@group(0) @binding(7) var<storage, read_write> v_isect_color: array<vec4<f32>>;
/// (x, y, |x|, |y|).
@group(0) @binding(8) var<storage, read_write> v_isect_xy: array<vec4<f32>>;
/// (xx, xy, yy of the covariance, 0).
@group(0) @binding(9) var<storage, read_write> v_isect_cov: array<vec4<f32>>;

#import blend_backward
