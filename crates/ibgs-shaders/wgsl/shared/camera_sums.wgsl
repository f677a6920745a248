// Gradient by a camera, summed in a fixed order: CAMERA_GROUPS workgroups leave a sum each in `partials`, which the kernel
// declares, and camera_total.wgsl adds these. The camera is [exp(rotation) R | exp(rotation) t + translation] in view space.
#import reduce

const THREADS: u32 = 256u;

struct CameraGradient {
    translation: vec3<f32>,
    rotation: vec3<f32>,
    focal: vec2<f32>,
    principal: vec2<f32>,
}

// Adds what the ray ((x - principal) / focal, 1) says of the lens.
fn add_ray(sum: ptr<function, CameraGradient>, focal: vec2<f32>, ray: vec2<f32>, v_ray: vec2<f32>) {
    let v = v_ray / focal;
    (*sum).focal -= v * ray;
    (*sum).principal -= v;
}

// Stores a workgroup's sum as three rows from `row` on. Every thread calls it, in uniform control flow.
fn store_camera(local: u32, row: u32, sum: CameraGradient) {
    let a = reduce(local, vec4(sum.translation, sum.focal.x));
    let b = reduce(local, vec4(sum.rotation, sum.focal.y));
    let c = reduce(local, vec4(sum.principal, 0.0, 0.0));
    if local == 0u {
        partials[row] = a;
        partials[row + 1u] = b;
        partials[row + 2u] = c;
    }
}
