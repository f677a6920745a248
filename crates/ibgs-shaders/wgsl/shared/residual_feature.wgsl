// The seven numbers of a visible source (method.md section 5), at the network's size.
// Reads the kernel's bindings base, warped, seen and centers.
#import residual_input

// The seven numbers and a one for the bias: (rgb, centre x), (centre y, centre z, cosine, 1).
struct Feature {
    head: vec4<f32>,
    tail: vec4<f32>,
}

fn base_at(p: u32) -> vec3<f32> {
    return vec3(base[3u * p], base[3u * p + 1u], base[3u * p + 2u]);
}

fn add_feature(p: u32, m: u32, weight: f32, sum: ptr<function, Feature>) {
    let source = slot_source(seen[p], m);
    if source == 255u {
        return;
    }
    let read = warped[m * params.size.x * params.size.y + p];
    let center = centers[source].xyz;
    var color = read.rgb;
    if params.inputs != INPUTS_SOURCE_COLORS {
        color -= base_at(p);
    }
    (*sum).head += weight * vec4(color, center.x);
    (*sum).tail += weight * vec4(center.yz, read.w, 0.0);
}

// The feature of slot m at a pixel of the network's size.
fn feature(c: Corners, m: u32) -> Feature {
    var sum = Feature(vec4(0.0), vec4(0.0, 0.0, 0.0, 1.0));
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

fn filled(p: u32, m: u32) -> f32 {
    return select(1.0, 0.0, slot_source(seen[p], m) == 255u);
}

// Part of slot m that a source fills at a pixel of the network's size.
fn presence(c: Corners, m: u32) -> f32 {
    if !resized() {
        return filled(c.at.x, m);
    }
    return dot(c.weight, vec4(filled(c.at.x, m), filled(c.at.y, m), filled(c.at.z, m), filled(c.at.w, m)));
}
