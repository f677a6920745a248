//! The U-Net's last two layers on the matrix units.
#set matrix
#stage unet
// The last two layers of the residual network on the matrix units: f = ReLU(1 x 1 of [d1, x]), output = 1 x 1 of f
// (method.md section 6). A subgroup takes twice SIDE pixels; f passes through workgroup memory.
#import half
#import index

/// The last two layers on the matrix units.
struct HalfHeadParams {
    /// Number of pixels.
    pixels: u32,
    /// First bias of the layer before the last.
    fuse_bias: u32,
    /// Where its packed weights begin, in groups of 4.
    fuse: u32,
    /// First bias of the last layer.
    last_bias: u32,
    /// Where its packed weights begin, in groups of 4.
    last: u32,
    /// 1: the input of the last layer is kept.
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
// The same of a matrix, and matrices side by side.
const OWN: u32 = SIDE / 4u;
const MATRICES: u32 = PADDED / SIDE;
const MATRIX: u32 = SIDE * OWN;
// Distances in workgroup memory; the padding avoids bank conflicts.
const LINE: u32 = QUADS + 2u;
const SUMS: u32 = OWN + 1u;
// A lane has two groups of 4 values of a matrix, of the same channels.
const_assert 2u * LANES == MATRIX && LANES % OWN == 0u;

// [subgroup][pixel][channels].
var<workgroup> f: array<vec4<f16>, HALF_SUBGROUPS * 2u * SIDE * LINE>;
// A matrix of sums of each subgroup.
var<workgroup> sums: array<vec4<f32>, HALF_SUBGROUPS * SIDE * SUMS>;

// Zero past the last one.
fn bias(first: u32, count: u32, o: u32) -> f32 {
    return select(0.0, weights[first + min(o, count - 1u)], o < count);
}

fn biases(first: u32, count: u32, o: u32) -> vec4<f32> {
    return vec4(bias(first, count, o), bias(first, count, o + 1u), bias(first, count, o + 2u), bias(first, count, o + 3u));
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
    let own_f = subgroup * 2u * SIDE * LINE;
    let own_q = lane % OWN;
    let first_pixel = (linear_workgroup(wid, groups) * HALF_SUBGROUPS + subgroup) * 2u * SIDE;
    #repeat m 2
    let p$m = first_pixel + $mu * SIDE;
    // The maps have room for whole matrices.
    let at$m = min(p$m, (params.pixels - 1u) / SIDE * SIDE) * QUADS;
    #end
    #repeat e 2
    let row$e = lane / OWN + $eu * LANES / OWN;
    #end
    // Three matrices of f at a time.
    for (var first = 0u; first < MATRICES; first += 3u) {
        #repeat m 2
        #repeat n 3
        var c$m$n = MatrixC();
        #end
        #end
        for (var k = 0u; k < MATRICES; k++) {
            #repeat m 2
            let left$m = coopLoadT<MatrixA>(&d1[at$m + k * OWN], QUADS);
            let right$m = coopLoadT<MatrixA>(&x[at$m + k * OWN], QUADS);
            #end
            let weight = params.fuse + (k * MATRICES + first) * MATRIX;
            #repeat n 3
            let u$n = coopLoad<MatrixB>(&packed[weight + $nu * MATRIX], OWN);
            let w$n = coopLoad<MatrixB>(&packed[weight + (MATRICES * MATRICES + $nu) * MATRIX], OWN);
            #repeat m 2
            c$m$n = coopMultiplyAdd(left$m, u$n, c$m$n);
            c$m$n = coopMultiplyAdd(right$m, w$n, c$m$n);
            #end
            #end
        }
        #repeat n 3
        let q$n = (first + $nu) * OWN + own_q;
        let bias$n = biases(params.fuse_bias, WIDTH, 4u * q$n);
        #repeat m 2
        coopStoreT(c$m$n, &sums[own], SUMS);
        subgroupBarrier();
        #repeat e 2
        {
            let h = to_half(max(sums[own + row$e * SUMS + own_q] + bias$n, vec4(0.0)));
            f[own_f + ($mu * SIDE + row$e) * LINE + q$n] = h;
            if params.keep == 1u && p$m + row$e < params.pixels {
                kept[(p$m + row$e) * QUADS + q$n] = h;
            }
        }
        #end
        subgroupBarrier();
        #end
        #end
    }
    #repeat m 2
    var r$m = MatrixC();
    let own_f$m = own_f + $mu * SIDE * LINE;
    #end
    for (var k = 0u; k < MATRICES; k++) {
        let b = coopLoad<MatrixB>(&packed[params.last + k * MATRIX], OWN);
        #repeat m 2
        r$m = coopMultiplyAdd(coopLoadT<MatrixA>(&f[own_f$m + k * OWN], LINE), b, r$m);
        #end
    }
    let bias = biases(params.last_bias, NETWORK_OUTPUTS, 0u);
    #repeat m 2
    coopStoreT(r$m, &sums[own], SUMS);
    subgroupBarrier();
    for (var k = lane; k < SIDE; k += LANES) {
        if p$m + k < params.pixels {
            residual[p$m + k] = sums[own + k * SUMS] + bias;
        }
    }
    subgroupBarrier();
    #end
}
