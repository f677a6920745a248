// The last two layers of the residual network on the matrix units: f = ReLU(1 x 1 of [d1, x]), output = 1 x 1 of f
// (method.md section 6). A subgroup takes SIDE pixels; f passes through workgroup memory.
#import half
#import index

struct HalfHeadParams {
    pixels: u32,
    // First bias and first packed weight (in groups of 4) of f, then of the output.
    fuse_bias: u32,
    fuse: u32,
    last_bias: u32,
    last: u32,
    // 1: f is kept.
    keep: u32,
}

var<immediate> params: HalfHeadParams;

@group(0) @binding(0) var<storage, read> weights: array<f32>;
@group(0) @binding(1) var<storage, read> packed: array<vec4<f16>>;
@group(0) @binding(2) var<storage, read> d1: array<vec4<f16>>;
@group(0) @binding(3) var<storage, read> x: array<vec4<f16>>;
@group(0) @binding(4) var<storage, read_write> residual: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> kept: array<vec4<f16>>;

const THREADS: u32 = HALF_SUBGROUPS * LANES;
const WIDTH: u32 = NETWORK_CHANNELS;
// Channels of d1, x and f with padding.
const PADDED: u32 = 48u;
const QUADS: u32 = PADDED / 4u;
// Distances in workgroup memory; the padding avoids bank conflicts.
const LINE: u32 = QUADS + 2u;
const SUMS: u32 = SIDE / 4u + 1u;
// Matrices side by side, and groups of 4 values of one.
const MATRICES: u32 = PADDED / SIDE;
const MATRIX: u32 = SIDE * SIDE / 4u;

// [subgroup][pixel][channels].
var<workgroup> f: array<vec4<f16>, 4u * SIDE * LINE>;
// A matrix of sums of each subgroup.
var<workgroup> sums: array<vec4<f32>, 4u * SIDE * SUMS>;

fn bias(first: u32, count: u32, o: u32) -> f32 {
    return select(0.0, weights[first + min(o, count - 1u)], o < count);
}

fn put_bias(own: u32, lane: u32, first: u32, count: u32, o: u32) {
    workgroupBarrier();
    for (var k = lane; k < SIDE * SIDE / 4u; k += LANES) {
        let c = o + 4u * (k % (SIDE / 4u));
        sums[own + (k / (SIDE / 4u)) * SUMS + k % (SIDE / 4u)] = vec4(
            bias(first, count, c),
            bias(first, count, c + 1u),
            bias(first, count, c + 2u),
            bias(first, count, c + 3u),
        );
    }
    workgroupBarrier();
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let subgroup = local / LANES;
    let lane = local % LANES;
    let own = subgroup * SIDE * SUMS;
    let own_f = subgroup * SIDE * LINE;
    // The maps have room for whole matrices.
    let p = (linear_workgroup(wid, groups) * 4u + subgroup) * SIDE;
    let at = min(p, (params.pixels - 1u) / SIDE * SIDE) * QUADS;
    for (var n = 0u; n < MATRICES; n++) {
        put_bias(own, lane, params.fuse_bias, WIDTH, n * SIDE);
        var c = coopLoadT<MatrixC>(&sums[own], SUMS);
        for (var k = 0u; k < MATRICES; k++) {
            let first = params.fuse + (k * MATRICES + n) * MATRIX;
            let second = first + MATRICES * MATRICES * MATRIX;
            let left = coopLoadT<MatrixA>(&d1[at + k * (SIDE / 4u)], QUADS);
            c = coopMultiplyAdd(left, coopLoad<MatrixB>(&packed[first], SIDE / 4u), c);
            let right = coopLoadT<MatrixA>(&x[at + k * (SIDE / 4u)], QUADS);
            c = coopMultiplyAdd(right, coopLoad<MatrixB>(&packed[second], SIDE / 4u), c);
        }
        coopStoreT(c, &sums[own], SUMS);
        workgroupBarrier();
        for (var k = lane; k < SIDE * SIDE / 4u; k += LANES) {
            let v = sums[own + (k / (SIDE / 4u)) * SUMS + k % (SIDE / 4u)];
            let h = to_half(max(v, vec4(0.0)));
            let q = n * (SIDE / 4u) + k % (SIDE / 4u);
            f[own_f + (k / (SIDE / 4u)) * LINE + q] = h;
            if params.keep == 1u && p < params.pixels {
                kept[(p + k / (SIDE / 4u)) * QUADS + q] = h;
            }
        }
    }
    put_bias(own, lane, params.last_bias, NETWORK_OUTPUTS, 0u);
    var r = coopLoadT<MatrixC>(&sums[own], SUMS);
    for (var k = 0u; k < MATRICES; k++) {
        let a = coopLoadT<MatrixA>(&f[own_f + k * (SIDE / 4u)], LINE);
        r = coopMultiplyAdd(a, coopLoad<MatrixB>(&packed[params.last + k * MATRIX], SIDE / 4u), r);
    }
    coopStoreT(r, &sums[own], SUMS);
    workgroupBarrier();
    for (var k = lane; k < SIDE; k += LANES) {
        if p + k < params.pixels {
            residual[p + k] = sums[own + k * SUMS];
        }
    }
}
