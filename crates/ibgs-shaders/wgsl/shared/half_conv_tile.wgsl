// What a workgroup of half_conv.wgsl reads: its tile of the input, and the weights. The kernel declares `params`, the bindings,
// `tile` and `kernel`.
#import residual_source

// The repetitions below are enough.
const_assert 12u * PIXELS >= ROWS * COLUMNS;
const_assert 14u * THREADS >= 27u * SIDE * QUADS;

// Where a pixel of the tile lies in an input of `quads` groups of 4 channels, or outside of it.
struct Place {
    at: u32,
    inside: bool,
}

fn place(p: u32, origin: vec2<i32>, source: vec2<u32>, mode: u32, quads: u32) -> Place {
    let x = source_of(origin.x + i32(p % COLUMNS) - 1, params.size.x, source.x, mode);
    let y = source_of(origin.y + i32(p / COLUMNS) - 1, params.size.y, source.y, mode);
    let inside = x >= 0 && y >= 0;
    return Place(select(0u, (u32(y) * source.x + u32(x)) * quads, inside), inside);
}

fn read_b(p: u32, q: u32, origin: vec2<i32>) -> vec4<f16> {
    let spot = place(p, origin, params.size, CONV_SAME, params.quads_b);
    return select(vec4<f16>(), input_b[spot.at + q], spot.inside);
}

fn read_same(p: u32, q: u32, origin: vec2<i32>) -> vec4<f16> {
    let spot = place(p, origin, params.size, CONV_SAME, params.quads_a);
    return select(vec4<f16>(), input_a[spot.at + q], spot.inside);
}

fn read_nearest(p: u32, q: u32, origin: vec2<i32>) -> vec4<f16> {
    let spot = place(p, origin, params.source, CONV_NEAREST, params.quads_a);
    return select(vec4<f16>(), input_a[spot.at + q], spot.inside);
}

fn read_pooled(p: u32, q: u32, origin: vec2<i32>) -> vec4<f16> {
    let spot = place(p, origin, params.source, CONV_POOLED, params.quads_a);
    let at = spot.at + q;
    let below = at + params.source.x * params.quads_a;
    let upper = max(input_a[at], input_a[at + params.quads_a]);
    let lower = max(input_a[below], input_a[below + params.quads_a]);
    return select(vec4<f16>(), max(upper, lower), spot.inside);
}

fn put(p: u32, q: u32, v: vec4<f16>) {
    if p < ROWS * COLUMNS {
        tile[(p / COLUMNS) * LINE + (p % COLUMNS) * PIXEL + q] = v;
    }
}

// Channels `chunk` SIDE and on of both inputs together. The reads of all steps are under way together.
fn load_tile(local: u32, origin: vec2<i32>, chunk: u32) {
    let p = local / QUADS;
    let own = local % QUADS;
    let q = chunk * QUADS + own;
    if chunk * QUADS >= params.quads_a {
        #repeat n 12
        let v$n = read_b(p + $nu * PIXELS, q - params.quads_a, origin);
        #end
        #repeat n 12
        put(p + $nu * PIXELS, own, v$n);
        #end
    } else if params.mode == CONV_POOLED {
        #repeat n 12
        let v$n = read_pooled(p + $nu * PIXELS, q, origin);
        #end
        #repeat n 12
        put(p + $nu * PIXELS, own, v$n);
        #end
    } else if params.mode == CONV_NEAREST {
        #repeat n 12
        let v$n = read_nearest(p + $nu * PIXELS, q, origin);
        #end
        #repeat n 12
        put(p + $nu * PIXELS, own, v$n);
        #end
    } else {
        #repeat n 12
        let v$n = read_same(p + $nu * PIXELS, q, origin);
        #end
        #repeat n 12
        put(p + $nu * PIXELS, own, v$n);
        #end
    }
}

fn read_kernel(k: u32, chunk: u32, group: u32) -> vec4<f16> {
    let tap = k / (3u * SIDE * QUADS);
    return packed[params.packed + ((9u * chunk + tap) * params.packed_groups + 3u * group) * SIDE * QUADS
        + k % (3u * SIDE * QUADS)];
}

fn put_kernel(k: u32, v: vec4<f16>) {
    if k < 27u * SIDE * QUADS {
        kernel[(k / QUADS) * OUTPUT + k % QUADS] = v;
    }
}

fn load_kernel(local: u32, chunk: u32, group: u32) {
    #repeat n 14
    let v$n = read_kernel(local + $nu * THREADS, chunk, group);
    #end
    #repeat n 14
    put_kernel(local + $nu * THREADS, v$n);
    #end
}
