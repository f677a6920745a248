// Real spherical harmonics up to degree 3 in the order and signs of 3D Gaussian splatting.

const SH0: f32 = 0.28209479177387814;
const SH1: f32 = 0.4886025119029199;
const SH2 = array<f32, 5>(1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396);
const SH3 = array<f32, 7>(
    -0.5900435899266435, 2.890611442640554, -0.4570457994644658, 0.3731763325901154,
    -0.4570457994644658, 1.445305721320277, -0.5900435899266435,
);

fn sh_count(degree: u32) -> u32 {
    return (degree + 1u) * (degree + 1u);
}

// Basis values in direction d (unit).
fn sh_basis(d: vec3<f32>, degree: u32) -> array<f32, 16> {
    var b: array<f32, 16>;
    b[0] = SH0;
    if degree < 1u {
        return b;
    }
    let x = d.x;
    let y = d.y;
    let z = d.z;
    b[1] = -SH1 * y;
    b[2] = SH1 * z;
    b[3] = -SH1 * x;
    if degree < 2u {
        return b;
    }
    let xx = x * x;
    let yy = y * y;
    let zz = z * z;
    b[4] = SH2[0] * x * y;
    b[5] = SH2[1] * y * z;
    b[6] = SH2[2] * (2.0 * zz - xx - yy);
    b[7] = SH2[3] * x * z;
    b[8] = SH2[4] * (xx - yy);
    if degree < 3u {
        return b;
    }
    b[9] = SH3[0] * y * (3.0 * xx - yy);
    b[10] = SH3[1] * x * y * z;
    b[11] = SH3[2] * y * (4.0 * zz - xx - yy);
    b[12] = SH3[3] * z * (2.0 * zz - 3.0 * xx - 3.0 * yy);
    b[13] = SH3[4] * x * (4.0 * zz - xx - yy);
    b[14] = SH3[5] * z * (xx - yy);
    b[15] = SH3[6] * x * (xx - 3.0 * yy);
    return b;
}

// One of them.
fn sh_basis_value(d: vec3<f32>, i: u32) -> f32 {
    let x = d.x;
    let y = d.y;
    let z = d.z;
    let xx = x * x;
    let yy = y * y;
    let zz = z * z;
    switch i {
        case 0u: { return SH0; }
        case 1u: { return -SH1 * y; }
        case 2u: { return SH1 * z; }
        case 3u: { return -SH1 * x; }
        case 4u: { return SH2[0] * x * y; }
        case 5u: { return SH2[1] * y * z; }
        case 6u: { return SH2[2] * (2.0 * zz - xx - yy); }
        case 7u: { return SH2[3] * x * z; }
        case 8u: { return SH2[4] * (xx - yy); }
        case 9u: { return SH3[0] * y * (3.0 * xx - yy); }
        case 10u: { return SH3[1] * x * y * z; }
        case 11u: { return SH3[2] * y * (4.0 * zz - xx - yy); }
        case 12u: { return SH3[3] * z * (2.0 * zz - 3.0 * xx - 3.0 * yy); }
        case 13u: { return SH3[4] * x * (4.0 * zz - xx - yy); }
        case 14u: { return SH3[5] * z * (xx - yy); }
        default: { return SH3[6] * x * (xx - 3.0 * yy); }
    }
}

// Gradient of basis function i by the direction, the direction taken as free (not on the sphere).
fn sh_basis_gradient(d: vec3<f32>, i: u32) -> vec3<f32> {
    let x = d.x;
    let y = d.y;
    let z = d.z;
    switch i {
        case 1u: { return vec3(0.0, -SH1, 0.0); }
        case 2u: { return vec3(0.0, 0.0, SH1); }
        case 3u: { return vec3(-SH1, 0.0, 0.0); }
        case 4u: { return SH2[0] * vec3(y, x, 0.0); }
        case 5u: { return SH2[1] * vec3(0.0, z, y); }
        case 6u: { return SH2[2] * vec3(-2.0 * x, -2.0 * y, 4.0 * z); }
        case 7u: { return SH2[3] * vec3(z, 0.0, x); }
        case 8u: { return SH2[4] * vec3(2.0 * x, -2.0 * y, 0.0); }
        case 9u: { return SH3[0] * vec3(6.0 * x * y, 3.0 * (x * x - y * y), 0.0); }
        case 10u: { return SH3[1] * vec3(y * z, x * z, x * y); }
        case 11u: { return SH3[2] * vec3(-2.0 * x * y, 4.0 * z * z - x * x - 3.0 * y * y, 8.0 * y * z); }
        case 12u: { return SH3[3] * vec3(-6.0 * x * z, -6.0 * y * z, 6.0 * z * z - 3.0 * x * x - 3.0 * y * y); }
        case 13u: { return SH3[4] * vec3(4.0 * z * z - 3.0 * x * x - y * y, -2.0 * x * y, 8.0 * x * z); }
        case 14u: { return SH3[5] * vec3(2.0 * x * z, -2.0 * y * z, x * x - y * y); }
        case 15u: { return SH3[6] * vec3(3.0 * (x * x - y * y), -6.0 * x * y, 0.0); }
        default: { return vec3(0.0); }
    }
}

// From the gradient by the unit direction of an offset to that by the offset.
fn along_sphere(offset: vec3<f32>, v_direction: vec3<f32>) -> vec3<f32> {
    let direction = normalize(offset);
    return (v_direction - direction * dot(direction, v_direction)) / length(offset);
}
