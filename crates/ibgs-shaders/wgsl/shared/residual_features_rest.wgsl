// What kernels of the U-Net's input share besides the features: how those of the sources become one, and the channels behind them.
#import residual_feature

// Unit viewing direction in world space through the centre of full-size pixel p.
fn world_ray(p: u32) -> vec3<f32> {
    let pixel = vec2<f32>(vec2(p % params.size.x, p / params.size.x));
    let d = (pixel - params.principal) / params.focal;
    return normalize(params.row0.xyz * d.x + params.row1.xyz * d.y + params.row2.xyz);
}

// Adds a source's values; `kept` and `share` are 1 but with confidences.
fn merge(sum: vec4<f32>, v: vec4<f32>, kept: f32, share: f32) -> vec4<f32> {
    return kept * sum + share * v;
}

// What the sum over `used` sources is multiplied by; `total`: the sum of their confidences.
fn merged_scale(used: u32, total: f32) -> f32 {
    return 1.0 / select(f32(max(used, 1u)), total, params.aggregation == AGGREGATION_SOFT);
}

// (viewing ray, red), (green, blue, 0, 0).
struct Rest {
    head: vec4<f32>,
    tail: vec4<f32>,
}

fn ray_and_color(c: Corners) -> Rest {
    var ray = world_ray(c.at.x);
    var color = base_at(c.at.x);
    if resized() {
        let w = c.weight;
        ray = w.x * ray + w.y * world_ray(c.at.y) + w.z * world_ray(c.at.z) + w.w * world_ray(c.at.w);
        ray = normalize(ray);
        color = w.x * color + w.y * base_at(c.at.y) + w.z * base_at(c.at.z) + w.w * base_at(c.at.w);
    }
    return Rest(vec4(ray, color.x), vec4(color.yz, 0.0, 0.0));
}
