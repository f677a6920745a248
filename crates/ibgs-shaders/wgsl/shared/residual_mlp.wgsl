// The per-view MLP on one thread: 32 sums in registers, weights broadcast from workgroup memory. The hidden
// channels come and go four at a time in a loop: written out, software drivers take minutes to compile it.
// Reads the kernel's binding `weights`.
#import residual_feature

// Rows of `mlp`: one an input, the 32 outputs side by side, the biases behind.
const ROW_BIAS1: u32 = FEATURES;
const ROW_WEIGHT2: u32 = ROW_BIAS1 + 1u;
const ROW_BIAS2: u32 = ROW_WEIGHT2 + HIDDEN;
const ROW_CONFIDENCE: u32 = ROW_BIAS2 + 1u;
// Behind the rows lie the confidence's weight of the error and its bias.
const CONFIDENCE_BIAS: u32 = 8u * (ROW_CONFIDENCE + 1u);
const MLP_VECTORS: u32 = CONFIDENCE_BIAS + 1u;

var<workgroup> mlp: array<vec4<f32>, MLP_VECTORS>;

// 32 channels; an array would be indexed in memory instead of registers.
struct Hidden {
    a: vec4<f32>,
    b: vec4<f32>,
    c: vec4<f32>,
    d: vec4<f32>,
    e: vec4<f32>,
    f: vec4<f32>,
    g: vec4<f32>,
    h: vec4<f32>,
}

fn load_mlp(local: u32, threads: u32) {
    for (var k = local; k < MLP_VECTORS; k += threads) {
        let row = k / 8u;
        var first = row;
        var stride = FEATURES;
        if row == ROW_BIAS1 {
            first = BIAS1;
            stride = 1u;
        } else if row == ROW_BIAS2 {
            first = BIAS2;
            stride = 1u;
        } else if k == CONFIDENCE_BIAS {
            mlp[k] = vec4(weights[CONFIDENCE_OFFSET + HIDDEN], weights[CONFIDENCE_OFFSET + HIDDEN + 1u], 0.0, 0.0);
            continue;
        } else if row == ROW_CONFIDENCE {
            first = CONFIDENCE_OFFSET;
            stride = 1u;
        } else if row >= ROW_WEIGHT2 {
            first = WEIGHT2 + row - ROW_WEIGHT2;
            stride = HIDDEN;
        }
        let at = first + 4u * (k % 8u) * stride;
        mlp[k] = vec4(weights[at], weights[at + stride], weights[at + 2u * stride], weights[at + 3u * stride]);
    }
    workgroupBarrier();
}

fn mlp_row(row: u32) -> Hidden {
    let r = 8u * row;
    return Hidden(mlp[r], mlp[r + 1u], mlp[r + 2u], mlp[r + 3u], mlp[r + 4u], mlp[r + 5u], mlp[r + 6u], mlp[r + 7u]);
}

fn add_row(row: u32, v: f32, sum: ptr<function, Hidden>) {
    let r = 8u * row;
    (*sum).a += v * mlp[r];
    (*sum).b += v * mlp[r + 1u];
    (*sum).c += v * mlp[r + 2u];
    (*sum).d += v * mlp[r + 3u];
    (*sum).e += v * mlp[r + 4u];
    (*sum).f += v * mlp[r + 5u];
    (*sum).g += v * mlp[r + 6u];
    (*sum).h += v * mlp[r + 7u];
}

fn add_rows(row: u32, v: vec4<f32>, sum: ptr<function, Hidden>) {
    add_row(row, v.x, sum);
    add_row(row + 1u, v.y, sum);
    add_row(row + 2u, v.z, sum);
    add_row(row + 3u, v.w, sum);
}

fn relu(v: Hidden) -> Hidden {
    let z = vec4(0.0);
    return Hidden(max(v.a, z), max(v.b, z), max(v.c, z), max(v.d, z), max(v.e, z), max(v.f, z), max(v.g, z), max(v.h, z));
}

// A sum with one more term, which may be its first.
fn with_term(sum: vec4<f32>, term: vec4<f32>, is_first: bool) -> vec4<f32> {
    return select(sum + term, term, is_first);
}

// Hidden channels 4 j .. 4 j + 3: the sums over each four numbers, their sum, then the biases.
fn mlp_hidden(j: u32, f: Feature) -> vec4<f32> {
    var parts: array<vec4<f32>, MLP_QUADS>;
    #repeat n MLP_FEATURES
    parts[$nu / 4u] = with_term(parts[$nu / 4u], f.numbers[$nu / 4u][$nu % 4u] * mlp[8u * $nu + j], $nu % 4u == 0u);
    #end
    var sum = vec4(0.0);
    #repeat q MLP_QUADS
    sum = with_term(sum, parts[$qu], $qu == 0u);
    #end
    return max(sum + mlp[8u * ROW_BIAS1 + j], vec4(0.0));
}

// The logarithm of the confidence in a source whose depth is off by `error`, before the hidden channels' part.
fn confidence_start(error: f32) -> f32 {
    return mlp[CONFIDENCE_BIAS].x * error + mlp[CONFIDENCE_BIAS].y;
}

// Adds the hidden channels' part of the logarithm of the confidence to `confidence`.
fn mlp_output(f: Feature, confidence: ptr<function, f32>) -> Hidden {
    var sum = mlp_row(ROW_BIAS2);
    for (var j = 0u; j < 8u; j++) {
        let hidden = mlp_hidden(j, f);
        add_rows(ROW_WEIGHT2 + 4u * j, hidden, &sum);
        if params.aggregation == AGGREGATION_SOFT {
            *confidence += dot(hidden, mlp[8u * ROW_CONFIDENCE + j]);
        }
    }
    return relu(sum);
}
