//! 3 x 3 convolution on the matrix units, partial sums of the gradient by weights and biases.
#set matrix
#stage unet weights
// Gradient of a 3 x 3 convolution's weights and biases on the matrix units: dW[tap][i][o] = sum over pixels of x[p + tap][i] v[p][o].
//
// A workgroup of nine subgroups, one a tap, walks through a part of the tiles of SIDE x SIDE / 2 pixels for 3 SIDE inputs (y of the
// workgroup) and 3 SIDE outputs (z): nine accumulators a subgroup, whose sums over a row's SIDE pixels are one product.
#import half_weights_tile
#import residual_source

/// Gradient of a convolution's weights on the matrix units.
struct HalfConvWeightsParams {
    /// Size of input and output in pixels.
    size: vec2<u32>,
    /// Size of what the input is read from.
    source: vec2<u32>,
    /// As [`ConvParams::mode`].
    mode: u32,
    /// Input channels.
    inputs: u32,
    /// The same with padding, divided by 8.
    pairs_in: u32,
    /// Output channels with padding, divided by 8.
    pairs_out: u32,
    /// Workgroups that share the image.
    splits: u32,
    /// Padding.
    pad: u32,
}

var<immediate> params: HalfConvWeightsParams;

@group(0) @binding(0) var<storage, read> v: array<Pair>;
@group(0) @binding(1) var<storage, read> input: array<Pair>;
/// [split][group of inputs][group of outputs][tap][input][output].
@group(0) @binding(2) var<storage, read_write> partials: array<f32>;

const THREADS: u32 = 9u * LANES;
const ROWS: u32 = SIDE / 2u;
const COLUMNS: u32 = SIDE + 2u;
// Groups of 8 channels in the tiles.
const X_PAIRS: u32 = (ROWS + 2u) * COLUMNS * PAIRS;
const V_PAIRS: u32 = ROWS * SIDE * PAIRS;
// The repetitions below are enough.
const_assert 4u * THREADS >= X_PAIRS;
const_assert 3u * THREADS >= V_PAIRS;

var<workgroup> x_tile: array<vec4<f16>, (ROWS + 2u) * COLUMNS * PIXEL>;
var<workgroup> v_tile: array<vec4<f16>, ROWS * SIDE * PIXEL>;

// Where the input of (x, y) lies.
fn input_at(x: i32, y: i32) -> u32 {
    if params.mode == CONV_NEAREST {
        let at = vec2<u32>(vec2(x, y)) * params.source / params.size;
        return (at.y * params.source.x + at.x) * params.pairs_in;
    }
    let step = select(1u, 2u, params.mode == CONV_POOLED);
    return (u32(y) * params.source.x + u32(x)) * params.pairs_in * step;
}

fn read_pooled(at: u32) -> Pair {
    let below = at + params.source.x * params.pairs_in;
    let upper = larger(input[at], input[at + params.pairs_in]);
    return larger(upper, larger(input[below], input[below + params.pairs_in]));
}

fn put_input(k: u32, pair: u32, value: Pair, inside: bool) {
    if k < X_PAIRS {
        let at = (k / PAIRS) * PIXEL + 2u * (k % PAIRS);
        x_tile[at] = select(vec4<f16>(), with_one(value.a, 8u * pair), inside);
        x_tile[at + 1u] = select(vec4<f16>(), with_one(value.b, 8u * pair + 4u), inside);
    }
}

fn put_v(k: u32, value: Pair, inside: bool) {
    if k < V_PAIRS {
        let at = (k / PAIRS) * PIXEL + 2u * (k % PAIRS);
        v_tile[at] = select(vec4<f16>(), value.a, inside);
        v_tile[at + 1u] = select(vec4<f16>(), value.b, inside);
    }
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let tap = local / LANES;
    let size = vec2<i32>(params.size);
    let tiles = (params.size + vec2(SIDE - 1u, ROWS - 1u)) / vec2(SIDE, ROWS);
    let count = tiles.x * tiles.y;
    let share = (count + params.splits - 1u) / params.splits;
    let end = min((wid.x + 1u) * share, count);
    #repeat i 3
    #repeat j 3
    var c$i$j = MatrixC();
    #end
    #end
    let first_in = wid.y * PAIRS;
    let first_out = wid.z * PAIRS;
    // Pixel of the tile and pair of each step; a pixel far out where there is none.
    let far = i32(0x4000000);
    #repeat n 4
    let kx$n = local + $nu * THREADS;
    let qx$n = first_in + kx$n % PAIRS;
    let px$n = vec2(select(far, i32((kx$n / PAIRS) % COLUMNS) - 1, qx$n < params.pairs_in), i32(kx$n / (PAIRS * COLUMNS)) - 1);
    #end
    #repeat n 3
    let kv$n = local + $nu * THREADS;
    let qv$n = first_out + kv$n % PAIRS;
    let pv$n = vec2(select(far, i32((kv$n / PAIRS) % SIDE), qv$n < params.pairs_out), i32(kv$n / (PAIRS * SIDE)));
    #end
    for (var t = wid.x * share; t < end; t++) {
        let corner = vec2<i32>(vec2(t % tiles.x, t / tiles.x) * vec2(SIDE, ROWS));
        // Bits of the steps.
        var inside = 0u;
        #repeat n 4
        let ax$n = corner + px$n;
        let ix$n = ax$n.x >= 0 && ax$n.y >= 0 && ax$n.x < size.x && ax$n.y < size.y;
        let at$n = select(0u, input_at(ax$n.x, ax$n.y) + qx$n, ix$n);
        inside |= select(0u, 1u << $nu, ix$n);
        var x$n = Pair();
        #end
        if params.mode == CONV_POOLED {
            #repeat n 4
            x$n = read_pooled(at$n);
            #end
        } else {
            #repeat n 4
            x$n = input[at$n];
            #end
        }
        #repeat n 3
        let av$n = corner + pv$n;
        let iv$n = av$n.x < size.x && av$n.y < size.y;
        let v$n = v[select(0u, u32(av$n.y * size.x + av$n.x) * params.pairs_out + qv$n, iv$n)];
        inside |= select(0u, 16u << $nu, iv$n);
        #end
        workgroupBarrier();
        #repeat n 4
        put_input(kx$n, qx$n, x$n, (inside & (1u << $nu)) != 0u);
        #end
        #repeat n 3
        put_v(kv$n, v$n, (inside & (16u << $nu)) != 0u);
        #end
        workgroupBarrier();
        for (var row = 0u; row < ROWS; row++) {
            let x = ((row + tap / 3u) * COLUMNS + tap % 3u) * PIXEL;
            let g = row * SIDE * PIXEL;
            // Rows are channels, columns pixels.
            #repeat i 3
            let a$i = coopLoad<MatrixA>(&x_tile[x + $iu * QUADS], PIXEL);
            #end
            #repeat i 3
            let b$i = coopLoadT<MatrixB>(&v_tile[g + $iu * QUADS], PIXEL);
            #end
            #repeat i 3
            #repeat j 3
            c$i$j = coopMultiplyAdd(a$i, b$j, c$i$j);
            #end
            #end
        }
    }
    // The indices need names: an index that is computed inside the call has no value yet there.
    let line = 3u * SIDE;
    let block = ((wid.x * groups.y + wid.y) * groups.z + wid.z) * 9u + tap;
    #repeat i 3
    #repeat j 3
    let at$i$j = (block * line + $iu * SIDE) * line + $ju * SIDE;
    coopStoreT(c$i$j, &partials[at$i$j], line);
    #end
    #end
}
