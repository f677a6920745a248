//! Gradient of the planes by means, normals and offsets.
#set train
#stage planes backward
// One thread a Gaussian: carries the gradient from its plane (n_c, D_c), which sum_rows_surface.wgsl has left in v_normals and
// v_plane_offsets, to the mean (added), the raw normal and the raw offset. Departs from the published code (method.md 10.1): each
// plane gets its derivative once.
#import index
#import frame
#import room

@group(0) @binding(0) var<storage, read> means: array<f32>;
@group(0) @binding(1) var<storage, read> normals: array<f32>;
@group(0) @binding(2) var<storage, read> plane_offsets: array<f32>;
@group(0) @binding(3) var<storage, read> planes: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> tile_counts: array<u32>;
@group(0) @binding(5) var<storage, read> total: array<u32>;
@group(0) @binding(6) var<storage, read_write> v_means: array<f32>;
@group(0) @binding(7) var<storage, read_write> v_normals: array<f32>;
@group(0) @binding(8) var<storage, read_write> v_plane_offsets: array<f32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let g = linear_workgroup(wid, groups) * 256u + local;
    if g >= frame.count {
        return;
    }
    var v_normal = vec3(0.0);
    var v_offset = 0.0;
    if tile_counts[g] > 0u && !ran_out_of_room() && any(planes[g] != vec4(0.0)) {
        let sum = vec4(v_normals[3u * g], v_normals[3u * g + 1u], v_normals[3u * g + 2u], v_plane_offsets[g]);
        let to_camera = frame.center - vec3(means[3u * g], means[3u * g + 1u], means[3u * g + 2u]);
        let raw = vec3(normals[3u * g], normals[3u * g + 1u], normals[3u * g + 2u]);
        let size = length(raw);
        let flip = select(1.0, -1.0, dot(to_camera, raw) < 0.0);
        let unit = raw / size;
        let distance = flip * (dot(unit, to_camera) + plane_offsets[g]);
        let v_distance = select(-sum.w, sum.w, distance >= 0.0);
        let v_unit = flip * (view_rotate_transposed(sum.xyz) + to_camera * v_distance);
        v_normal = (v_unit - unit * dot(unit, v_unit)) / size;
        v_offset = flip * v_distance;
        let v_mean = unit * v_offset;
        for (var c = 0u; c < 3u; c++) {
            v_means[3u * g + c] -= v_mean[c];
        }
    }
    for (var c = 0u; c < 3u; c++) {
        v_normals[3u * g + c] = v_normal[c];
    }
    v_plane_offsets[g] = v_offset;
}
