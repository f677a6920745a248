// The numbers of a visible source (method.md section 5), at the network's size.
// Reads the kernel's bindings base, warped, seen and centers.
#import residual_input
#import residual_mlp_layout

// The numbers, a one, and zeros: as many as matrix units of 16 x 16 take, four a vector. They are indexed by constants alone, so
// that they lie in registers.
struct Feature {
    numbers: array<vec4<f32>, 4>,
}

fn add_feature(p: u32, m: u32, weight: f32, sum: ptr<function, Feature>) {
    if !is_seen(seen[p], m) {
        return;
    }
    let source = seen_source(seen[p], m);
    let read = warped[m * params.size.x * params.size.y + p];
    let center = centers[source].xyz;
    (*sum).numbers[0] += weight * vec4(read.rgb - base_at(p), center.x);
    (*sum).numbers[1] += weight * vec4(center.yz, read.w, 0.0);
}

// The feature of the m-th visible source at a pixel of the network's size.
fn feature(c: Corners, m: u32) -> Feature {
    var sum = Feature();
    sum.numbers[ONE / 4u][ONE % 4u] = 1.0;
    if resized() {
        add_feature(c.at.x, m, c.weight.x, &sum);
        add_feature(c.at.y, m, c.weight.y, &sum);
        add_feature(c.at.z, m, c.weight.z, &sum);
        add_feature(c.at.w, m, c.weight.w, &sum);
    } else {
        add_feature(c.at.x, m, 1.0, &sum);
    }
    return sum;
}

// (1, error of the depth as a part of what agrees) where pixel p of the image has an m-th visible source, else zeros.
fn filling(p: u32, m: u32) -> vec2<f32> {
    if !is_seen(seen[p], m) {
        return vec2(0.0);
    }
    return vec2(1.0, relative_error(seen[p], m));
}

// How much of a pixel of the network's size has an m-th visible source, and the error of its depth there.
fn presence(c: Corners, m: u32) -> vec2<f32> {
    if !resized() {
        return filling(c.at.x, m);
    }
    let sum = c.weight.x * filling(c.at.x, m) + c.weight.y * filling(c.at.y, m) + c.weight.z * filling(c.at.z, m)
        + c.weight.w * filling(c.at.w, m);
    return vec2(sum.x, select(0.0, sum.y / sum.x, sum.x > 0.0));
}
