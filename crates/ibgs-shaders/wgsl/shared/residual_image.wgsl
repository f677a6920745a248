// The image around the residual network: base colours, and whether the network runs at another size. Reads the kernel's binding base,
// and size and low of its parameters.

fn base_at(p: u32) -> vec3<f32> {
    return vec3(base[3u * p], base[3u * p + 1u], base[3u * p + 2u]);
}

fn resized() -> bool {
    return any(params.size != params.low);
}
