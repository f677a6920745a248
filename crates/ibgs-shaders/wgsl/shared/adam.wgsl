// Adam with bias correction (method.md section 1), eps added to the corrected root. The values beyond the head decay by
// themselves, not through the gradient (Loshchilov and Hutter, Decoupled Weight Decay Regularization, 2019).

/// One Adam step of one tensor.
struct AdamParams {
    /// Number of values.
    count: u32,
    /// Values a row.
    row: u32,
    /// Leading values of a row that step with `rate`.
    head: u32,
    /// Learning rate of the head.
    rate: f32,
    /// Learning rate of the rest of the row.
    rate_rest: f32,
    /// Decay of the first moment.
    beta1: f32,
    /// Decay of the second moment.
    beta2: f32,
    /// Added to the root of the corrected second moment.
    eps: f32,
    /// 1 / (1 - beta1^t).
    correction1: f32,
    /// 1 / (1 - beta2^t).
    correction2: f32,
    /// Share of a value of the rest that is lost, times its rate.
    decay_rest: f32,
    /// t, the number of the step from 1.
    step: u32,
    /// Of spherical harmonics: the centre of the camera that the gradient is by.
    center: vec3<f32>,
    /// Of spherical harmonics: their active degree.
    sh_degree: u32,
}

var<immediate> params: AdamParams;

// Both moments after the gradient g.
fn adam_moments(m: vec2<f32>, g: f32) -> vec2<f32> {
    let m1 = params.beta1 * m.x + (1.0 - params.beta1) * g;
    let m2 = params.beta2 * m.y + (1.0 - params.beta2) * g * g;
    return vec2(m1, m2);
}

// A value of a column of its row after the step.
fn adam_value(value: f32, column: u32, m: vec2<f32>) -> f32 {
    let is_head = column < params.head;
    let rate = select(params.rate_rest, params.rate, is_head);
    let kept = select(1.0 - rate * params.decay_rest, 1.0, is_head);
    return kept * value - rate * (m.x * params.correction1) / (sqrt(m.y * params.correction2) + params.eps);
}

@group(0) @binding(1) var<storage, read_write> values: array<f32>;

#if HARMONICS
#import sh

/// By the colour of each Gaussian.
@group(0) @binding(0) var<storage, read> gradient: array<f32>;

// How the colour of a Gaussian depends on its coefficient c.
fn harmonic(row: u32, c: u32) -> f32 {
    let mean = vec3(means[3u * row], means[3u * row + 1u], means[3u * row + 2u]);
    return sh_basis_value(normalize(mean - params.center), c);
}

// Gradient by a value of a row. Without that by its colour the mean may be no number.
fn adam_gradient(row: u32, column: u32) -> f32 {
    let v_color = gradient[3u * row + column % 3u];
    let c = column / 3u;
    if c >= sh_count(params.sh_degree) || v_color == 0.0 {
        return 0.0;
    }
    return harmonic(row, c) * v_color;
}

// The same by the three values from this column on.
fn adam_gradients(row: u32, column: u32) -> vec3<f32> {
    let v_color = vec3(gradient[3u * row], gradient[3u * row + 1u], gradient[3u * row + 2u]);
    let c = column / 3u;
    if c >= sh_count(params.sh_degree) || all(v_color == vec3(0.0)) {
        return vec3(0.0);
    }
    return harmonic(row, c) * v_color;
}
#else
@group(0) @binding(0) var<storage, read> gradient: array<f32>;

// Gradient by a value of a row.
fn adam_gradient(row: u32, column: u32) -> f32 {
    return gradient[row * params.row + column];
}

// The same by the three values from this column on.
fn adam_gradients(row: u32, column: u32) -> vec3<f32> {
    let i = row * params.row + column;
    return vec3(gradient[i], gradient[i + 1u], gradient[i + 2u]);
}
#endif
