// Gradients by the two inputs of the layer before the last on the matrix units: v_d1, through the ReLU of d1, takes the place
// of d1; v_x takes that of f. A subgroup takes SIDE pixels.
#import half
#import index

struct HalfHeadBackwardParams {
    pixels: u32,
    // First packed weight, in groups of 4.
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
const SUMS: u32 = SIDE / 4u + 1u;

// A matrix of sums of each subgroup.
var<workgroup> sums: array<vec4<f32>, 4u * SIDE * SUMS>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let subgroup = local / LANES;
    let lane = local % LANES;
    let own = subgroup * SIDE * SUMS;
    let p = (linear_workgroup(wid, groups) * 4u + subgroup) * SIDE;
    let at = min(p, (params.pixels - 1u) / SIDE * SIDE) * QUADS;
    for (var k = lane; k < SIDE * SUMS; k += LANES) {
        sums[own + k] = vec4(0.0);
    }
    workgroupBarrier();
    let zero = coopLoadT<MatrixC>(&sums[own], SUMS);
    for (var n = 0u; n < 2u * PADDED / SIDE; n++) {
        var c = zero;
        for (var k = 0u; k < PADDED / SIDE; k++) {
            let a = coopLoadT<MatrixA>(&v_f[at + k * (SIDE / 4u)], QUADS);
            // The transpose: rows are outputs of f, columns its inputs.
            let at_b = params.fuse + (n * (PADDED / SIDE) + k) * SIDE * (SIDE / 4u);
            let b = coopLoadT<MatrixB>(&packed[at_b], SIDE / 4u);
            c = coopMultiplyAdd(a, b, c);
        }
        coopStoreT(c, &sums[own], SUMS);
        workgroupBarrier();
        for (var k = lane; k < SIDE * SIDE / 4u; k += LANES) {
            let pixel = p + k / (SIDE / 4u);
            let q = n * (SIDE / 4u) + k % (SIDE / 4u);
            let v = sums[own + (k / (SIDE / 4u)) * SUMS + k % (SIDE / 4u)];
            if pixel < params.pixels {
                if q < QUADS {
                    let i = pixel * QUADS + q;
                    d1[i] = to_half(select(vec4(0.0), v, d1[i] > vec4<f16>()));
                } else {
                    f[pixel * QUADS + q - QUADS] = to_half(v);
                }
            }
        }
        workgroupBarrier();
    }
}
