// The bilinear read of a source's photo, as it is differentiated. The kernel imports `source` and declares `texels`, the four texels of a
// landing.

struct Read {
    valid: bool,
    // Gradient of the loss by the colour read, times the colour, and the same along the texel coordinates.
    color: f32,
    slope: vec2<f32>,
}

fn read_photo(l: Landing, v: vec3<f32>) -> Read {
    let t = texels(l);
    let c = vec4(
        dot(v, unpack4x8unorm(t.x).rgb),
        dot(v, unpack4x8unorm(t.y).rgb),
        dot(v, unpack4x8unorm(t.z).rgb),
        dot(v, unpack4x8unorm(t.w).rgb),
    );
    var read: Read;
    read.valid = (t.x & t.y & t.z & t.w & 0x80000000u) != 0u;
    read.color = dot(bilinear_weights(l.fraction), c);
    read.slope = mix(vec2(c.y - c.x, c.z - c.x), vec2(c.w - c.z, c.w - c.y), l.fraction.yx);
    return read;
}
