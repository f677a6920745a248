//! Gradient of the composition.
#set train
#stage compose backward
// One thread a pixel of either size: gradient of the final colour by the network's output, and by the base colour as far as it does
// not pass through the sources' mean difference. The resize is transposed as a gather.
#import index
#import residual_output
#import residual_difference

@group(0) @binding(0) var<storage, read> most_visible: array<u32>;
/// Visible sources of the pixels.
@group(0) @binding(1) var<storage, read> seen: array<u32>;
@group(0) @binding(2) var<storage, read> base: array<f32>;
@group(0) @binding(3) var<storage, read> warped: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> residual: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> v_image: array<f32>;
@group(0) @binding(6) var<storage, read_write> v_residual: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> v_base: array<f32>;

fn v_at(p: u32) -> vec3<f32> {
    return vec3(v_image[3u * p], v_image[3u * p + 1u], v_image[3u * p + 2u]);
}

// The gradient by the network's output at a pixel.
fn v_reached(p: u32) -> vec4<f32> {
    if !is_reached(seen[p]) {
        return vec4(0.0);
    }
    let v = v_at(p);
    if params.output != OUTPUT_GATED {
        return vec4(v, 0.0);
    }
    let gate = sigmoid(output_at(p).w);
    return vec4(v, gate * (1.0 - gate) * dot(v, mean_difference(p).xyz));
}

fn gathered(pixel: vec2<u32>) -> vec4<f32> {
    let columns = resize_readers(pixel.x, params.low.x, params.size.x);
    let rows = resize_readers(pixel.y, params.low.y, params.size.y);
    var sum = vec4(0.0);
    for (var y = rows.x; y <= rows.y; y++) {
        let down = resize_weight(y, pixel.y, params.low.y, params.size.y);
        for (var x = columns.x; x <= columns.y; x++) {
            let weight = down * resize_weight(x, pixel.x, params.low.x, params.size.x);
            if weight > 0.0 {
                sum += weight * v_reached(y * params.size.x + x);
            }
        }
    }
    return sum;
}

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_workgroup(wid, groups) * 256u + local;
    let used = most_visible[0] > 0u;
    if i < params.size.x * params.size.y {
        let v = select(1.0, params.gain, is_reached(seen[i])) * v_at(i);
        v_base[3u * i] = v.x;
        v_base[3u * i + 1u] = v.y;
        v_base[3u * i + 2u] = v.z;
    }
    if i < params.low.x * params.low.y {
        var v = vec4(0.0);
        if used {
            if resized() {
                v = gathered(vec2(i % params.low.x, i / params.low.x));
            } else {
                v = v_reached(i);
            }
        }
        v_residual[i] = v;
    }
}
