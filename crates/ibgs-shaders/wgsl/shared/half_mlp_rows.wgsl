// How half_features_backward.wgsl writes its row of gradients by the weights of the per-view MLP. The kernel declares `partials`.
#import half_mlp_pixels

// A sum of the workgroup's subgroups.
fn total(row: u32, column: u32) -> f32 {
    var sum = 0.0;
    for (var s = 0u; s < SUBGROUPS; s++) {
        sum += sums[(s * LANES + row) * SUMS + column / 4u][column % 4u];
    }
    return params.unscale * sum;
}

// Writes the gradient by the weight of output o and input i of the second layer.
fn put2(out: u32, o: u32, i: u32, value: f32) {
    let f = i - HIDDEN;
    if o < HIDDEN {
        if i < HIDDEN {
            partials[out + WEIGHT2 + o * HIDDEN + i] = value;
        } else if f == ONE {
            partials[out + BIAS2 + o] = value;
        }
    } else if o == HIDDEN {
        if i < HIDDEN {
            partials[out + MLP_WEIGHTS + i] = value;
        } else if f == ERROR {
            partials[out + MLP_WEIGHTS + HIDDEN] = value;
        } else if f == ONE {
            partials[out + MLP_WEIGHTS + HIDDEN + 1u] = value;
        }
    }
}
