//! Base colour, sources and the network's output to the final colour.
#set render
#stage compose
// One thread a pixel: the final colour from base colour and the network's output, which is resized to the image's size with
// corners aligned (method.md section 6).
#import index
#import residual_output
#import residual_difference

@group(0) @binding(0) var<storage, read> most_visible: array<u32>;
/// Visible sources of the pixels.
@group(0) @binding(1) var<storage, read> seen: array<u32>;
@group(0) @binding(2) var<storage, read> base: array<f32>;
@group(0) @binding(3) var<storage, read> warped: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> residual: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> image: array<f32>;

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
    var color = select(1.0, params.gain, reached) * base_at(p);
    if used && reached {
        let given = output_at(p);
        color += given.xyz;
        if params.output == OUTPUT_GATED {
            color += sigmoid(given.w) * mean_difference(p).xyz;
        }
    }
    image[3u * p] = color.x;
    image[3u * p + 1u] = color.y;
    image[3u * p + 2u] = color.z;
}
