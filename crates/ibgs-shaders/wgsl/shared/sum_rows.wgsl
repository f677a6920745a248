// One thread a Gaussian: the rows of gradients of its intersections, which lie one behind the other, summed in a
// fixed order. The sums go where the gradients go that `project_backward` and `planes_backward` make of them: colour and opacity to
// the rotations, (x, y, |x|) to the means and |y| to the opacities, covariance to the scales. SURFACE: with the planes' rows.
//
// SUBGROUPS: the rows of a large Gaussian are summed by the lanes of its subgroup together, because one thread would take longer
// for them than the others for all of theirs.

#import index
#import frame
#import room

@group(0) @binding(0) var<storage, read> offsets: array<u32>;
@group(0) @binding(1) var<storage, read> tile_counts: array<u32>;
@group(0) @binding(2) var<storage, read> total: array<u32>;
@group(0) @binding(3) var<storage, read> v_isect_color: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> v_isect_xy: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> v_isect_cov: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> v_rotations: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> v_means: array<f32>;
@group(0) @binding(8) var<storage, read_write> v_opacity_logits: array<f32>;
@group(0) @binding(9) var<storage, read_write> v_log_scales: array<f32>;
#if SURFACE
@group(0) @binding(10) var<storage, read> v_isect_plane: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read_write> v_normals: array<f32>;
@group(0) @binding(12) var<storage, read_write> v_plane_offsets: array<f32>;
#endif

// Parts of the Gaussians, of which neighbouring threads take one each.
const SPREAD: u32 = 32u;

struct Rows {
    // (r, g, b, opacity), (x, y, |x|, |y|), (xx, xy, yy of the covariance, 0), (n_c, D_c).
    color: vec4<f32>,
    xy: vec4<f32>,
    cov: vec4<f32>,
    #if SURFACE
    plane: vec4<f32>,
    #endif
}

// The sum of every `step`-th of `count` rows.
fn add_rows(start: u32, count: u32, step: u32) -> Rows {
    var sum: Rows;
    for (var i = start; i < start + count; i += step) {
        sum.color += v_isect_color[i];
        sum.xy += v_isect_xy[i];
        sum.cov += v_isect_cov[i];
        #if SURFACE
        sum.plane += v_isect_plane[i];
        #endif
    }
    return sum;
}

#if SUBGROUPS
// Most rows that a thread sums alone.
const OWN_ROWS: u32 = 16u;

fn sum_rows(start: u32, count: u32, lane: u32) -> Rows {
    let is_large = count > OWN_ROWS;
    var sum = add_rows(start, select(count, 0u, is_large), 1u);
    var left = subgroupBallot(is_large).x;
    while left != 0u {
        let owner = firstTrailingBit(left);
        left &= left - 1u;
        let rows = subgroupShuffle(count, owner);
        let part = add_rows(subgroupShuffle(start, owner) + lane, max(rows, lane) - lane, LANES);
        let color = subgroupAdd(part.color);
        let xy = subgroupAdd(part.xy);
        let cov = subgroupAdd(part.cov);
        #if SURFACE
        let plane = subgroupAdd(part.plane);
        #endif
        if lane == owner {
            sum.color = color;
            sum.xy = xy;
            sum.cov = cov;
            #if SURFACE
            sum.plane = plane;
            #endif
        }
    }
    return sum;
}
#endif

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
    #if SUBGROUPS
    @builtin(subgroup_invocation_id) lane: u32,
    #endif
) {
    // Neighbours are often large together, such as those that were split from one: they go to different subgroups.
    let thread = linear_workgroup(wid, groups) * 256u + local;
    let stride = (frame.count + SPREAD - 1u) / SPREAD;
    let column = thread / SPREAD;
    let g = select(frame.count, (thread % SPREAD) * stride + column, column < stride);
    let last = frame.count - 1u;
    // Without room there is not a row for every intersection.
    let count = select(0u, tile_counts[min(g, last)], g <= last && !ran_out_of_room());
    let start = offsets[min(g, last)];
    #if SUBGROUPS
    let sum = sum_rows(start, count, lane);
    #else
    let sum = add_rows(start, count, 1u);
    #endif
    if count == 0u {
        return;
    }
    v_rotations[g] = sum.color;
    v_means[3u * g] = sum.xy.x;
    v_means[3u * g + 1u] = sum.xy.y;
    v_means[3u * g + 2u] = sum.xy.z;
    v_opacity_logits[g] = sum.xy.w;
    v_log_scales[3u * g] = sum.cov.x;
    v_log_scales[3u * g + 1u] = sum.cov.y;
    v_log_scales[3u * g + 2u] = sum.cov.z;
    #if SURFACE
    v_normals[3u * g] = sum.plane.x;
    v_normals[3u * g + 1u] = sum.plane.y;
    v_normals[3u * g + 2u] = sum.plane.z;
    v_plane_offsets[g] = sum.plane.w;
    #endif
}
