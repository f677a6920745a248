//! Colours of one source photo at the median intersections, visibility, packing.
#set render
#stage warp
// One thread a pixel, one source a dispatch, in order: reads the source's photo where the median intersections fall,
// decides by depth whether the source sees the pixel's point, and packs it (method.md section 5). Departs from the published
// code (method.md 10.5): the depth test decides.
#import source
#import seen

@group(0) @binding(0) var<storage, read> median_depth: array<f32>;
/// K planes of (view depth, weight).
@group(0) @binding(1) var<storage, read> intersections: array<vec2<f32>>;
/// RGBA8; a read that touches a texel with alpha under one half does not count.
@group(0) @binding(2) var<storage, read> photo: array<u32>;
/// The source's own median depth.
@group(0) @binding(3) var<storage, read> source_depth: array<f32>;
/// V planes of (r, g, b, cosine).
@group(0) @binding(4) var<storage, read_write> warped: array<vec4<f32>>;
/// One byte a visible source.
@group(0) @binding(5) var<storage, read_write> seen: array<u32>;
/// [0]: visible sources of the pixel that has most.
@group(0) @binding(6) var<storage, read_write> most_visible: array<atomic<u32>>;

var<workgroup> most: atomic<u32>;

// (r, g, b, 1), or zero where a texel is masked.
fn read_photo(l: Landing) -> vec4<f32> {
    let t00 = photo[l.texel];
    let t10 = photo[l.texel + 1u];
    let t01 = photo[l.texel + params.source_size.x];
    let t11 = photo[l.texel + params.source_size.x + 1u];
    let w = bilinear_weights(l.fraction);
    let color = w.x * unpack4x8unorm(t00) + w.y * unpack4x8unorm(t10) + w.z * unpack4x8unorm(t01)
        + w.w * unpack4x8unorm(t11);
    let valid = (t00 & t10 & t01 & t11 & 0x80000000u) != 0u;
    return select(vec4(0.0), vec4(color.rgb, 1.0), valid);
}

// The source's depth at the point less the point's, as a part of the latter; negative where the source has none.
fn depth_error(l: Landing) -> f32 {
    let stored = dot(
        bilinear_weights(l.fraction),
        vec4(
            source_depth[l.texel],
            source_depth[l.texel + 1u],
            source_depth[l.texel + params.source_size.x],
            source_depth[l.texel + params.source_size.x + 1u],
        ),
    );
    return select(-1.0, abs(stored - l.depth) / l.depth, stored > 0.0);
}

@compute @workgroup_size(TILE, TILE)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    if local == 0u {
        atomicStore(&most, 0u);
    }
    workgroupBarrier();
    if all(id.xy < params.size) {
        let plane = params.size.x * params.size.y;
        let p = id.y * params.size.x + id.x;
        var packed = 0xffffffffu;
        if params.index == 0u {
            for (var m = 0u; m < params.visible; m++) {
                warped[m * plane + p] = vec4(0.0);
            }
        } else {
            packed = seen[p];
        }
        let count = (32u - countLeadingZeros(~packed) + 7u) / 8u;
        let ray = source_ray(id.xy);
        let z = median_depth[p];
        var sum = vec4(0.0);
        var error_step = 0u;
        if count < params.visible && z > 0.0 {
            let median = land(ray, z);
            var error = -1.0;
            if median.inside {
                error = depth_error(median);
            }
            if error >= 0.0 && error < params.reach * params.agreement {
                error_step = min(u32(f32(ERROR_STEPS) * error / params.agreement), MOST_ERROR);
                for (var k = 0u; k < params.intersections; k++) {
                    let intersection = intersections[k * plane + p];
                    if intersection.y > 0.0 {
                        let l = land(ray, intersection.x);
                        if l.inside {
                            sum += intersection.y * read_photo(l);
                        }
                    }
                }
            }
        }
        if sum.w > 0.0 {
            warped[count * plane + p] = vec4(sum.rgb / (sum.w + SOURCE_EPSILON), ray_cosine(ray, z).x);
            let step = select(error_step, 0u, params.reach == 1.0);
            packed = (packed & ~(255u << (8u * count))) | ((params.index | (step << 4u)) << (8u * count));
            atomicMax(&most, count + 1u);
        }
        seen[p] = packed;
    }
    workgroupBarrier();
    if local == 0u {
        atomicMax(&most_visible[0], atomicLoad(&most));
    }
}
