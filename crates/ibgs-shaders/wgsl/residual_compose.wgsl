// One thread a pixel: the final colour from base colour and residual, which is resized to the image's size with corners
// aligned (method.md section 6).
#import index
#import residual_output

@group(0) @binding(0) var<storage, read> most_visible: array<u32>;
// Visible sources of the pixels.
@group(0) @binding(1) var<storage, read> seen: array<u32>;
@group(0) @binding(2) var<storage, read> base: array<f32>;
@group(0) @binding(3) var<storage, read> residual: array<f32>;
@group(0) @binding(4) var<storage, read_write> image: array<f32>;

fn residual_at(p: u32) -> vec3<f32> {
    return vec3(residual[3u * p], residual[3u * p + 1u], residual[3u * p + 2u]);
}

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let p = linear_workgroup(wid, groups) * 256u + local;
    if p >= params.size.x * params.size.y {
        return;
    }
    let used = most_visible[0] > 0u;
    let reached = is_reached(seen[p]);
    var color = vec3(base[3u * p], base[3u * p + 1u], base[3u * p + 2u]);
    color *= select(1.0, base_share(used), reached);
    if used && reached {
        if all(params.size == params.low) {
            color += residual_at(p);
        } else {
            let c = resize_corners(vec2(p % params.size.x, p / params.size.x), params.low, params.size);
            color += c.weight.x * residual_at(c.at.x) + c.weight.y * residual_at(c.at.y)
                + c.weight.z * residual_at(c.at.z) + c.weight.w * residual_at(c.at.w);
        }
    }
    image[3u * p] = color.x;
    image[3u * p + 1u] = color.y;
    image[3u * p + 2u] = color.z;
}
