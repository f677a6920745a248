//! Gradients by the inputs of the U-Net's layer before the last.
#set matrix
#stage unet backward
// Gradients by the two inputs of the layer before the last on the matrix units: v_d1, through the ReLU of d1, takes the place
// of d1; v_x takes that of f. A subgroup takes SIDE pixels.
#import half
#import index

/// Gradients by the inputs of the layer before the last.
struct HalfHeadBackwardParams {
    /// Number of pixels.
    pixels: u32,
    /// Where its packed weights begin, in groups of 4.
    fuse: u32,
}

var<immediate> params: HalfHeadBackwardParams;

@group(0) @binding(0) var<storage, read> packed: array<vec4<f16>>;
@group(0) @binding(1) var<storage, read> v_f: array<vec4<f16>>;
@group(0) @binding(2) var<storage, read_write> d1: array<vec4<f16>>;
@group(0) @binding(3) var<storage, read_write> f: array<vec4<f16>>;

const THREADS: u32 = HALF_SUBGROUPS * LANES;
// Channels of d1, x and f with padding.
const PADDED: u32 = 48u;
const QUADS: u32 = PADDED / 4u;
// The same of a matrix, and matrices side by side.
const OWN: u32 = SIDE / 4u;
const MATRICES: u32 = PADDED / SIDE;
const MATRIX: u32 = SIDE * OWN;
const SUMS: u32 = OWN + 1u;
// A lane has two groups of 4 values of a matrix, of the same channels.
const_assert 2u * LANES == MATRIX && LANES % OWN == 0u;

// A matrix of sums of each subgroup.
var<workgroup> sums: array<vec4<f32>, HALF_SUBGROUPS * SIDE * SUMS>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let subgroup = local / LANES;
    let lane = local % LANES;
    let own = subgroup * SIDE * SUMS;
    let own_q = lane % OWN;
    let p = (linear_workgroup(wid, groups) * HALF_SUBGROUPS + subgroup) * SIDE;
    // The maps have room for whole matrices.
    let at = min(p, (params.pixels - 1u) / SIDE * SIDE) * QUADS;
    #repeat e 2
    let pixel$e = p + lane / OWN + $eu * LANES / OWN;
    let at_sum$e = own + (lane / OWN + $eu * LANES / OWN) * SUMS + own_q;
    #end
    // Three matrices at a time, those of d1 first.
    for (var first = 0u; first < 2u * MATRICES; first += 3u) {
        let of_d1 = first < MATRICES;
        let first_q = select(first - MATRICES, first, of_d1) * OWN + own_q;
        #repeat n 3
        var c$n = MatrixC();
        #repeat e 2
        let goal$n$e = min(pixel$e, params.pixels - 1u) * QUADS + first_q + $nu * OWN;
        var open$n$e = vec4(true);
        if of_d1 {
            open$n$e = d1[goal$n$e] > vec4<f16>();
        }
        #end
        #end
        for (var k = 0u; k < MATRICES; k++) {
            let a = coopLoadT<MatrixA>(&v_f[at + k * OWN], QUADS);
            #repeat n 3
            // The transpose: rows are outputs of f, columns its inputs.
            let at_b$n = params.fuse + ((first + $nu) * MATRICES + k) * MATRIX;
            let b$n = coopLoadT<MatrixB>(&packed[at_b$n], OWN);
            c$n = coopMultiplyAdd(a, b$n, c$n);
            #end
        }
        #repeat n 3
        coopStoreT(c$n, &sums[own], SUMS);
        subgroupBarrier();
        #repeat e 2
        if pixel$e < params.pixels {
            let v = to_half(select(vec4(0.0), sums[at_sum$e], open$n$e));
            if of_d1 {
                d1[goal$n$e] = v;
            } else {
                f[goal$n$e] = v;
            }
        }
        #end
        subgroupBarrier();
        #end
    }
}
