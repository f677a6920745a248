// The 3D smoothing filter (Yu et al., "Mip-Splatting", CVPR 2024): a Gaussian convolved with an isotropic one of standard
// deviation `filter_size`, its opacity lowered so that its mass stays.
struct Filtered {
    scale: vec3<f32>,
    // Squared ratio of the scales before and after, along each axis.
    ratio: vec3<f32>,
    // Factor of the opacity.
    gain: f32,
}

fn filtered(scale: vec3<f32>, filter_size: f32) -> Filtered {
    if filter_size == 0.0 {
        return Filtered(scale, vec3(1.0), 1.0);
    }
    let squared = scale * scale;
    let wide = squared + filter_size * filter_size;
    let ratio = squared / wide;
    return Filtered(sqrt(wide), ratio, sqrt(ratio.x * ratio.y * ratio.z));
}
