// For processors. A driver in software reads memory lane by lane, so what a lane reads goes to the others by exchanges, and nothing
// passes through workgroup memory.
//
// A subgroup owns 40 outputs, five to a lane, x 5 inputs x 9 taps. It goes down strips of 6 pixels: the lanes hold the inputs of a
// row with the halo, a column each, of three rows at a time.
#import residual_source

const STRIP: vec2<u32> = vec2(6u, 8u);

// [output of the lane][input][row][column] and [output of the lane].
var<private> sums: array<f32, 225>;
var<private> biases: array<f32, 5>;
// [row][input].
var<private> rows: array<f32, 15>;

// Moves the rows up and reads the one behind.
fn next_row(first: u32, lane: u32, corner: vec2<i32>) {
    let x = source_of(corner.x + i32(lane) - 1, params.size.x, params.source.x, params.mode);
    let y = source_of(corner.y, params.size.y, params.source.y, params.mode);
    let inside = x >= 0 && y >= 0;
    let at = select(0u, u32(y) * params.source.x + u32(x), inside);
    let plane = params.source.x * params.source.y;
    #repeat i 10
    rows[$i] = rows[$i + 5];
    #end
    #repeat i 5
    let wanted_$i = inside && first + $iu < params.inputs;
    let at_$i = select(0u, (first + $iu) * plane + at, wanted_$i);
    rows[10 + $i] = input[at_$i];
    #end
    // The others of 2 x 2.
    for (var step = 1u; step < select(1u, 4u, params.mode == CONV_POOLED); step++) {
        let shift = (step / 2u) * params.source.x + step % 2u;
        #repeat i 5
        rows[10 + $i] = max(rows[10 + $i], input[at_$i + shift]);
        #end
    }
    #repeat i 5
    rows[10 + $i] = select(0.0, rows[10 + $i], wanted_$i);
    #end
}

@compute @workgroup_size(8u * LANES)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(subgroup_id) subgroup: u32,
    @builtin(subgroup_invocation_id) lane: u32,
) {
    let first = 5u * subgroup;
    let strips = (params.size + STRIP - 1u) / STRIP;
    let count = select(0u, strips.x * strips.y, first < params.inputs);
    let share = (count + params.splits - 1u) / params.splits;
    let plane = params.size.x * params.size.y;
    for (var t = wid.x * share; t < min((wid.x + 1u) * share, count); t++) {
        let corner = vec2(t % strips.x, t / strips.x) * STRIP;
        next_row(first, lane, vec2<i32>(corner) - vec2(0, 1));
        next_row(first, lane, vec2<i32>(corner));
        for (var y = corner.y; y < min(corner.y + STRIP.y, params.size.y); y++) {
            next_row(first, lane, vec2(i32(corner.x), i32(y) + 1));
            for (var j = 0u; j < min(STRIP.x, params.size.x - corner.x); j++) {
                let at = y * params.size.x + corner.x + j;
                #repeat q 5
                let is_output_$q = 8u * $qu + lane < params.outputs;
                let v_$q = select(0.0, v[select(0u, (8u * $qu + lane) * plane + at, is_output_$q)], is_output_$q);
                biases[$q] += v_$q;
                #end
                #repeat i 5
                #repeat row 3
                #repeat column 3
                {
                    let x = subgroupShuffle(rows[5 * $row + $i], j + $columnu);
                    #repeat q 5
                    sums[(($q * 5 + $i) * 3 + $row) * 3 + $column] = fma(v_$q, x, sums[(($q * 5 + $i) * 3 + $row) * 3 + $column]);
                    #end
                }
                #end
                #end
                #end
            }
        }
    }
    let weights = params.outputs * params.inputs * 9u;
    let base = wid.x * (weights + params.outputs);
    #repeat q 5
    if 8u * $qu + lane < params.outputs {
        #repeat i 5
        if first + $iu < params.inputs {
            let at = base + ((8u * $qu + lane) * params.inputs + first + $iu) * 9u;
            #repeat tap 9
            partials[at + $tapu] = sums[($q * 5 + $i) * 9 + $tap];
            #end
        }
        #end
        if subgroup == 0u {
            partials[base + weights + 8u * $qu + lane] = biases[$q];
        }
    }
    #end
}
