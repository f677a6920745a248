// One workgroup: the affine map A x + t that takes base colours x to the other colours y by least squares (method.md section
// 8). With the means taken out three unknowns a channel remain:
//     (C + ridge 1) (A - 1)^T = (G - C)^T,    C = sum d d^T,  G = sum e d^T,  d = x - mean x,  e = y - mean y.
// The ridge is 1e-6 of the mean variance and pulls towards the identity what the colours leave open. With fewer than 64 pixels, a
// smallest pivot under 1e-5 of the largest, or a largest one under a variance of 1e-8 the first map is the identity, and the
// others are as the first.
#import reduce

// Rows of seven: (sum x, count), (sum y, 0), (d_r d, d_g d_g), (d_g d_b, d_b d_b, 0, 0), e_r d, e_g d, e_b d.
@group(0) @binding(0) var<storage, read> partials: array<vec4<f32>>;
// Number of the map.
var<immediate> index: u32;

// Three rows of [A | t] a map.
@group(0) @binding(1) var<storage, read_write> affine: array<vec4<f32>>;

@compute @workgroup_size(EXPOSURE_GROUPS)
fn main(@builtin(local_invocation_index) local: u32) {
    let row = 7u * local;
    let part_x = partials[row];
    let part_y = partials[row + 1u];
    let total_x = reduce(local, part_x);
    let total_y = reduce(local, part_y);
    let count = total_x.w;
    let mean_x = total_x.xyz / max(count, 1.0);
    let mean_y = total_y.xyz / max(count, 1.0);
    // From the workgroup's means to the common ones.
    let n = part_x.w;
    let d = part_x.xyz / max(n, 1.0) - mean_x;
    let e = part_y.xyz / max(n, 1.0) - mean_y;
    let xx = reduce(local, partials[row + 2u] + n * vec4(d.x * d, d.y * d.y));
    let yz = reduce(local, partials[row + 3u] + n * vec4(d.y * d.z, d.z * d.z, 0.0, 0.0));
    let by_red = reduce(local, partials[row + 4u] + n * vec4(e.x * d, 0.0)).xyz;
    let by_green = reduce(local, partials[row + 5u] + n * vec4(e.y * d, 0.0)).xyz;
    let by_blue = reduce(local, partials[row + 6u] + n * vec4(e.z * d, 0.0)).xyz;
    if local != 0u {
        return;
    }
    var rows = mat3x4(vec4(1.0, 0.0, 0.0, 0.0), vec4(0.0, 1.0, 0.0, 0.0), vec4(0.0, 0.0, 1.0, 0.0));
    let identity = rows;
    if index > 0u {
        rows = mat3x4(affine[0], affine[1], affine[2]);
    }
    let c = mat3x3(xx.xyz, vec3(xx.y, xx.w, yz.x), vec3(xx.z, yz.x, yz.y));
    let ridge = EXPOSURE_RIDGE * (c[0][0] + c[1][1] + c[2][2]) / 3.0;
    // C + ridge 1 = L D L^T.
    let d0 = c[0][0] + ridge;
    let l10 = c[0][1] / d0;
    let l20 = c[0][2] / d0;
    let d1 = c[1][1] + ridge - l10 * c[0][1];
    let rest = c[1][2] - l10 * c[0][2];
    let l21 = rest / d1;
    let d2 = c[2][2] + ridge - l20 * c[0][2] - l21 * rest;
    let smallest = min(d0, min(d1, d2));
    let largest = max(d0, max(d1, d2));
    // Asked so that a NaN anywhere gives the identity.
    if count >= EXPOSURE_PIXELS && smallest >= EXPOSURE_PIVOT * largest && largest >= EXPOSURE_VARIANCE * count {
        let right = mat3x3(by_red - c[0], by_green - c[1], by_blue - c[2]);
        for (var channel = 0u; channel < 3u; channel++) {
            let b = right[channel];
            let z1 = b.y - l10 * b.x;
            let z2 = b.z - l20 * b.x - l21 * z1;
            let a2 = z2 / d2;
            let a1 = z1 / d1 - l21 * a2;
            let a0 = b.x / d0 - l10 * a1 - l20 * a2;
            let change = vec3(a0, a1, a2);
            let offset = mean_y[channel] - mean_x[channel] - dot(change, mean_x);
            rows[channel] = identity[channel] + vec4(change, offset);
        }
    }
    for (var channel = 0u; channel < 3u; channel++) {
        affine[3u * index + channel] = rows[channel];
    }
}
