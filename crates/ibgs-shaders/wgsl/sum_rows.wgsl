// Sums of the gradients of each Gaussian's intersections.
#import index
#import frame
#import room

@group(0) @binding(0) var<storage, read> depth_order: array<u32>;
@group(0) @binding(1) var<storage, read> offsets: array<u32>;
@group(0) @binding(2) var<storage, read> tile_counts: array<u32>;
@group(0) @binding(3) var<storage, read> total: array<u32>;
@group(0) @binding(4) var<storage, read> v_isect_color: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> v_isect_xy: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> v_isect_cov: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> v_rotations: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> v_screen: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read_write> v_log_scales: array<f32>;

#import sum_rows
