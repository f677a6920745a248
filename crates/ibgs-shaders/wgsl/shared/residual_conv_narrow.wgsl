// For processors: a driver in software reads memory lane by lane, so what a thread reads is used as often as it can be, nothing
// passes through workgroup memory, and no workgroup is larger than the image.
//
// A thread owns 4 pixels of a column times 20 output channels, a subgroup a block of 8 x 4 pixels. The lanes read the 180 weights
// of an input channel together, and each is broadcast. Six parts of the source are the rows of the block and its halo, two the
// columns at its left and right; a lane gets what is beside its own from its neighbours. Sums are those of the other form, bit for
// bit: one `fma` after the other, by input channel, then column, then row of the taps, and the bias last.
#import index
#import residual_map
#import residual_source

// Pixels of a column, weights of an input channel, and the reads of a lane for them.
const DEPTH: u32 = 4u;
const WEIGHTS: u32 = 9u * CONV_OUTPUTS;
const READS: u32 = (WEIGHTS + LANES - 1u) / LANES;

var<private> sums: array<vec4<f32>, CONV_OUTPUTS>;
// Of one input channel: the lane's parts of the source, three columns of six pixels, and its weights.
var<private> parts: array<f32, 8>;
var<private> pixels: array<f32, 18>;
var<private> lane_weights: array<f32, READS>;

#if PACKED
fn store(o: u32, x: u32, y: u32, sums: vec2<f32>, biases: vec2<f32>) {
    if o >= params.outputs || x >= params.size.x || y >= params.size.y {
        return;
    }
    let values = max(sums + biases, vec2(0.0));
    output[((o / CHANNELS) * params.size.y + y) * params.size.x + x] = word(values.x, values.y);
}
#else
fn store_one(o: u32, x: u32, y: u32, sum: f32, bias: f32) {
    if o >= params.outputs || x >= params.size.x || y >= params.size.y {
        return;
    }
    let i = (o * params.size.y + y) * params.size.x + x;
    var value = sum;
    if params.store == STORE_RELU {
        value = max(sum + bias, 0.0);
    } else if params.store != STORE_ASSIGN {
        let there = output[i];
        value = select(select(0.0, sum, there > 0.0), there + sum, params.store == STORE_ADD);
    }
    output[i] = value;
}

fn store(o: u32, x: u32, y: u32, sums: vec2<f32>, biases: vec2<f32>) {
    store_one(o, x, y, sums.x, biases.x);
    store_one(o + 1u, x, y, sums.y, biases.y);
}
#endif

@compute @workgroup_size(128)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(subgroup_id) subgroup: u32,
    @builtin(subgroup_invocation_id) lane: u32,
) {
    let columns = (params.size.x + LANES - 1u) / LANES;
    let task = linear_workgroup(wid, groups) * (128u / LANES) + subgroup;
    let group = task % params.groups;
    let x = LANES * ((task / params.groups) % columns) + lane;
    let y = DEPTH * ((task / params.groups) / columns);
    if y >= params.size.y {
        return;
    }
    // Places of the lane's parts in a plane of the source; -1 outside.
    var at: array<i32, 8>;
    #repeat k 8
    {
        let row = select(lane, $ku, $k < 6);
        let from_row = source_of(i32(y + row) - 1, params.size.y, params.source.y, params.mode);
        let column = select(i32(x - lane) + select(-1, 8, $k == 7), i32(x), $k < 6);
        let from_column = source_of(column, params.size.x, params.source.x, params.mode);
        at[$k] = select(from_row * i32(params.source.x) + from_column, -1, min(from_row, from_column) < 0);
    }
    #end
    // Places of a lane's weights, and whether they are there.
    var first_weight: array<u32, READS>;
    var is_weight: array<bool, READS>;
    #repeat k 23
    {
        let number = $k * LANES + lane;
        let o = group * CONV_OUTPUTS + number % CONV_OUTPUTS;
        let tap = min(number / CONV_OUTPUTS, 8u);
        is_weight[$k] = number < WEIGHTS && o < params.outputs;
        first_weight[$k] = select(0u, params.weights + o * params.stride_out + select(tap, 8u - tap, params.turned == 1u), is_weight[$k]);
    }
    #end
    #repeat o 20
    sums[$o] = vec4(0.0);
    #end
    let plane = i32(params.source.x * params.source.y);
    let steps = select(1u, 4u, params.mode == CONV_POOLED);
    for (var c = 0u; c < params.channels_a + params.channels_b; c++) {
        let second = c >= params.channels_a;
        let channel = select(c, c - params.channels_a, second);
        let first = i32(channel / CHANNELS) * plane;
        if second {
            #repeat k 8
            parts[$k] = number(input_b[first + max(at[$k], 0)], channel);
            #end
        } else {
            #repeat k 8
            parts[$k] = number(input_a[first + max(at[$k], 0)], channel);
            #end
            // The others of 2 x 2.
            for (var step = 1u; step < steps; step++) {
                let shift = first + i32((step / 2u) * params.source.x + step % 2u);
                #repeat k 8
                parts[$k] = max(parts[$k], number(input_a[max(at[$k], 0) + shift], channel));
                #end
            }
        }
        #repeat k 8
        parts[$k] = select(parts[$k], 0.0, at[$k] < 0);
        #end
        #repeat row 6
        {
            let left = subgroupShuffle(parts[$row], (lane + 7u) % LANES);
            let right = subgroupShuffle(parts[$row], (lane + 1u) % LANES);
            pixels[3 * $row] = select(left, subgroupBroadcast(parts[6], $rowu), lane == 0u);
            pixels[3 * $row + 1] = parts[$row];
            pixels[3 * $row + 2] = select(right, subgroupBroadcast(parts[7], $rowu), lane == LANES - 1u);
        }
        #end
        #repeat k 23
        lane_weights[$k] = select(0.0, weights[first_weight[$k] + select(0u, c * params.stride_in, is_weight[$k])], is_weight[$k]);
        #end
        // In the order of the other form, so that both give the same bits.
        #repeat o 20
        #repeat column 3
        #repeat row 3
        sums[$o] = fma(
            vec4(subgroupBroadcast(lane_weights[(20 * (3 * $row + $column) + $o) / 8], (20u * (3u * $row + $column) + $o) % 8u)),
            vec4(
                pixels[3 * $row + $column],
                pixels[3 * $row + $column + 3],
                pixels[3 * $row + $column + 6],
                pixels[3 * $row + $column + 9],
            ),
            sums[$o],
        );
        #end
        #end
        #end
    }
    // The biases are read together too.
    var biases: array<f32, 3>;
    #repeat k 3
    biases[$k] = weights[params.bias + min(group * CONV_OUTPUTS + $k * LANES + lane, params.outputs - 1u)];
    #end
    #repeat q 10
    {
        let o = group * CONV_OUTPUTS + 2u * $qu;
        let bias = vec2(
            subgroupBroadcast(biases[(2 * $q) / 8], (2u * $qu) % 8u),
            subgroupBroadcast(biases[(2 * $q) / 8], (2u * $qu) % 8u + 1u),
        );
        store(o, x, y, vec2(sums[2 * $q].x, sums[2 * $q + 1].x), bias);
        store(o, x, y + 1u, vec2(sums[2 * $q].y, sums[2 * $q + 1].y), bias);
        store(o, x, y + 2u, vec2(sums[2 * $q].z, sums[2 * $q + 1].z), bias);
        store(o, x, y + 3u, vec2(sums[2 * $q].w, sums[2 * $q + 1].w), bias);
    }
    #end
}
