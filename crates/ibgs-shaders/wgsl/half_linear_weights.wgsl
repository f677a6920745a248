//! 1 x 1 convolution on the matrix units, partial sums of the gradient by weights and biases.
#set matrix
#stage unet weights
// Gradient of a 1 x 1 convolution's weights and biases on the matrix units: dW[i][o] = sum over pixels of x[p][i] v[p][o].
//
// A workgroup of nine subgroups walks through a part of the pixels, 3 SIDE at a time, for 3 SIDE inputs (y of the workgroup) and
// 3 SIDE outputs (z): a subgroup SIDE inputs by SIDE outputs.
#import half_weights_tile

/// Gradient of a 1 x 1 convolution's weights on the matrix units.
struct HalfLinearWeightsParams {
    /// Pixels of input and output.
    pixels: u32,
    /// Input channels.
    inputs: u32,
    /// The same with padding, divided by 8.
    pairs_in: u32,
    /// Output channels with padding, divided by 8.
    pairs_out: u32,
    /// Workgroups that share the image.
    splits: u32,
}

var<immediate> params: HalfLinearWeightsParams;

@group(0) @binding(0) var<storage, read> v: array<Pair>;
@group(0) @binding(1) var<storage, read> input: array<Pair>;
/// [split][group of inputs][group of outputs][input][output].
@group(0) @binding(2) var<storage, read_write> partials: array<f32>;

const THREADS: u32 = 9u * LANES;
const STEP: u32 = 3u * SIDE;
// A thread reads 8 channels of one pixel.
const_assert THREADS >= STEP * PAIRS;

var<workgroup> x_tile: array<vec4<f16>, STEP * PIXEL>;
var<workgroup> v_tile: array<vec4<f16>, STEP * PIXEL>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let subgroup = local / LANES;
    let steps = (params.pixels + STEP - 1u) / STEP;
    let share = (steps + params.splits - 1u) / params.splits;
    let end = min((wid.x + 1u) * share, steps);
    let pair_in = wid.y * PAIRS + local % PAIRS;
    let pair_out = wid.z * PAIRS + local % PAIRS;
    let at = (local / PAIRS) * PIXEL + 2u * (local % PAIRS);
    let own_x = (subgroup / 3u) * QUADS;
    let own_v = (subgroup % 3u) * QUADS;
    var c = MatrixC();
    for (var t = wid.x * share; t < end; t++) {
        let p = t * STEP + local / PAIRS;
        let inside = p < params.pixels;
        let x_inside = inside && pair_in < params.pairs_in;
        let v_inside = inside && pair_out < params.pairs_out;
        let x = input[select(0u, p * params.pairs_in + pair_in, x_inside)];
        let g = v[select(0u, p * params.pairs_out + pair_out, v_inside)];
        workgroupBarrier();
        if local < STEP * PAIRS {
            x_tile[at] = select(vec4<f16>(), with_one(x.a, 8u * pair_in), x_inside);
            x_tile[at + 1u] = select(vec4<f16>(), with_one(x.b, 8u * pair_in + 4u), x_inside);
            v_tile[at] = select(vec4<f16>(), g.a, v_inside);
            v_tile[at + 1u] = select(vec4<f16>(), g.b, v_inside);
        }
        workgroupBarrier();
        // Rows are channels, columns pixels.
        #repeat k 3
        let x$k = $ku * SIDE * PIXEL + own_x;
        let v$k = $ku * SIDE * PIXEL + own_v;
        c = coopMultiplyAdd(coopLoad<MatrixA>(&x_tile[x$k], PIXEL), coopLoadT<MatrixB>(&v_tile[v$k], PIXEL), c);
        #end
    }
    let line = 3u * SIDE;
    let block = (wid.x * groups.y + wid.y) * groups.z + wid.z;
    let into = (block * line + (subgroup / 3u) * SIDE) * line + (subgroup % 3u) * SIDE;
    coopStoreT(c, &partials[into], line);
}
