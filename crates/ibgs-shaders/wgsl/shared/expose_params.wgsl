struct ExposeParams {
    background: vec3<f32>,
    pixels: u32,
}

var<immediate> params: ExposeParams;
