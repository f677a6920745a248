// Mean difference between the colours of a pixel's sources and its base colour, D = sum w_m (c_m - C) / (DOUBT + sum w_m) with
// w_m = exp(-e_m^2 / 2 - (1 - cosine) / SPREAD), e_m the error of the source's depth in units of what agrees; 0 where the pixel
// sees no source. With OUTPUT_GATED the network's fourth output, through the sigmoid, is its share in the final colour.
// Reads the kernel's bindings base, warped, seen and residual, and size, low and visible of its parameters.
#import residual_image
#import resize
#import seen

// Difference 1 - cosine of the viewing directions at which a source counts 1/e.
const SPREAD: f32 = 0.05;
// What stands against the sources' weights.
const DOUBT: f32 = 0.05;

// (c_m - C, w_m) of the m-th visible source; zeros where there is none.
fn difference(p: u32, m: u32) -> vec4<f32> {
    if m >= params.visible || !is_seen(seen[p], m) {
        return vec4(0.0);
    }
    let read = warped[m * params.size.x * params.size.y + p];
    let error = relative_error(seen[p], m);
    return vec4(read.rgb - base_at(p), exp(-0.5 * error * error - (1.0 - read.w) / SPREAD));
}

// (D, DOUBT + sum w_m).
fn mean_difference(p: u32) -> vec4<f32> {
    var sum = vec4(0.0, 0.0, 0.0, DOUBT);
    for (var m = 0u; m < params.visible; m++) {
        let d = difference(p, m);
        sum += vec4(d.w * d.xyz, d.w);
    }
    return vec4(sum.xyz / sum.w, sum.w);
}

// The network's output at a pixel of the image: resized with corners aligned.
fn output_at(p: u32) -> vec4<f32> {
    if !resized() {
        return residual[p];
    }
    let c = resize_corners(vec2(p % params.size.x, p / params.size.x), params.low, params.size);
    return c.weight.x * residual[c.at.x] + c.weight.y * residual[c.at.y]
        + c.weight.z * residual[c.at.z] + c.weight.w * residual[c.at.w];
}

fn sigmoid(x: f32) -> f32 {
    return 1.0 / (1.0 + exp(-x));
}
