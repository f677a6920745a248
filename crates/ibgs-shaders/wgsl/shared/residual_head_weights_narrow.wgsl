// For processors. A driver in software reads memory lane by lane, so what a lane reads goes to the others by exchanges, and nothing
// passes through workgroup memory.
//
// A subgroup owns 40 outputs of the first layer, five to a lane, x the inputs from d1 or those from x. The lanes are eight pixels where
// they read the inputs.

const LANE_OUTPUTS: u32 = 5u;

// [input][output of the lane], and the sums of the other gradients: [output of the last layer][output of the lane].
var<private> sums: array<f32, WIDTH * LANE_OUTPUTS>;
var<private> biases: array<f32, LANE_OUTPUTS>;
var<private> last_sums: array<f32, OUTPUTS * LANE_OUTPUTS>;
var<private> last_biases: vec4<f32>;
// Inputs of the lane's pixel; the last layer's weights, as their sums.
var<private> inputs: array<f32, WIDTH>;
var<private> last_weights: array<f32, OUTPUTS * LANE_OUTPUTS>;

// Adds pixel p of the lanes' pixels, of which `v` is the gradient by the output.
fn add(p: u32, first: u32, v: vec4<f32>, lane: u32) {
    let at = min(first + p, params.pixels - 1u);
    #repeat q 5
    let f_$q = f[min(8u * $qu + lane, WIDTH - 1u) * params.pixels + at];
    let by_f_$q = v.x * last_weights[$q] + v.y * last_weights[5 + $q] + v.z * last_weights[10 + $q] + v.w * last_weights[15 + $q];
    let v_$q = select(0.0, by_f_$q, f_$q > 0.0);
    biases[$q] += v_$q;
    #repeat c 4
    last_sums[5 * $c + $q] += v[$c] * f_$q;
    #end
    #end
    last_biases += v;
    #repeat i 38
    {
        let input = subgroupShuffle(inputs[$i], p);
        #repeat q 5
        sums[5 * $i + $q] = fma(v_$q, input, sums[5 * $i + $q]);
        #end
    }
    #end
}

@compute @workgroup_size(2u * LANES)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(subgroup_id) subgroup: u32,
    @builtin(subgroup_invocation_id) lane: u32,
) {
    #repeat q 5
    #repeat c 4
    last_weights[5 * $c + $q] = weights[params.last + $cu * WIDTH + min(8u * $qu + lane, WIDTH - 1u)];
    #end
    #end
    let blocks = (params.pixels + LANES - 1u) / LANES;
    let share = (blocks + groups.x - 1u) / groups.x;
    for (var block = wid.x * share; block < min((wid.x + 1u) * share, blocks); block++) {
        let first = LANES * block;
        let own = min(first + lane, params.pixels - 1u);
        if subgroup == 0u {
            #repeat i 38
            inputs[$i] = d1[$iu * params.pixels + own];
            #end
        } else {
            #repeat i 38
            inputs[$i] = x[$iu * params.pixels + own];
            #end
        }
        let v = select(vec4(0.0), v_residual[own], first + lane < params.pixels);
        for (var p = 0u; p < LANES; p++) {
            add(p, first, subgroupShuffle(v, p), lane);
        }
    }
    let base = wid.x * STRIDE;
    let behind = base + WIDTH * INPUTS;
    #repeat q 5
    if 8u * $qu + lane < WIDTH {
        let o = 8u * $qu + lane;
        #repeat i 38
        partials[base + o * INPUTS + subgroup * WIDTH + $iu] = sums[5 * $i + $q];
        #end
        if subgroup == 0u {
            partials[behind + o] = biases[$q];
            #repeat c 4
            partials[behind + ($cu + 1u) * WIDTH + o] = last_sums[5 * $c + $q];
            #end
        }
    }
    #end
    if subgroup == 0u && lane == 0u {
        #repeat c 4
        partials[behind + 5u * WIDTH + $cu] = last_biases[$c];
        #end
    }
}
