// The tile of the input that a workgroup of half_conv.wgsl reads. The kernel declares `params`, the bindings and `tile`.
#import residual_source

// The repetitions below are enough.
const_assert 4u * PIXELS >= ROWS * COLUMNS;

// Where a pixel of the tile lies in an input of `pairs` groups of 8 channels, or outside of it.
struct Place {
    at: u32,
    inside: bool,
}

struct Read {
    value: Pair,
    inside: bool,
}

fn place(p: u32, origin: vec2<i32>, source: vec2<u32>, mode: u32, pairs: u32) -> Place {
    let x = source_of(origin.x + i32(p % COLUMNS) - 1, params.size.x, source.x, mode);
    let y = source_of(origin.y + i32(p / COLUMNS) - 1, params.size.y, source.y, mode);
    let inside = x >= 0 && y >= 0;
    return Place(select(0u, (u32(y) * source.x + u32(x)) * pairs, inside), inside);
}

fn read_b(p: u32, q: u32, origin: vec2<i32>) -> Read {
    let spot = place(p, origin, params.size, CONV_SAME, params.pairs_b);
    return Read(input_b[spot.at + q], spot.inside);
}

fn read_same(p: u32, q: u32, origin: vec2<i32>) -> Read {
    let spot = place(p, origin, params.size, CONV_SAME, params.pairs_a);
    return Read(input_a[spot.at + q], spot.inside);
}

fn read_nearest(p: u32, q: u32, origin: vec2<i32>) -> Read {
    let spot = place(p, origin, params.source, CONV_NEAREST, params.pairs_a);
    return Read(input_a[spot.at + q], spot.inside);
}

fn read_pooled(p: u32, q: u32, origin: vec2<i32>) -> Read {
    let spot = place(p, origin, params.source, CONV_POOLED, params.pairs_a);
    let at = spot.at + q;
    let below = at + params.source.x * params.pairs_a;
    let upper = larger(input_a[at], input_a[at + params.pairs_a]);
    return Read(larger(upper, larger(input_a[below], input_a[below + params.pairs_a])), spot.inside);
}

fn put(p: u32, q: u32, v: Read) {
    if p < ROWS * COLUMNS {
        let at = (p / COLUMNS) * LINE + (p % COLUMNS) * PIXEL + 2u * q;
        tile[at] = select(vec4<f16>(), v.value.a, v.inside);
        tile[at + 1u] = select(vec4<f16>(), v.value.b, v.inside);
    }
}

// Channels `chunk` SIDE and on of both inputs together. The reads of all steps are under way together, while other subgroups may
// still use the channels before.
fn load_tile(local: u32, origin: vec2<i32>, chunk: u32) {
    let p = local / PAIRS;
    let own = local % PAIRS;
    let q = chunk * PAIRS + own;
    #repeat n 4
    var v$n = Read();
    #end
    if chunk * PAIRS >= params.pairs_a {
        #repeat n 4
        v$n = read_b(p + $nu * PIXELS, q - params.pairs_a, origin);
        #end
    } else if params.mode == CONV_POOLED {
        #repeat n 4
        v$n = read_pooled(p + $nu * PIXELS, q, origin);
        #end
    } else if params.mode == CONV_NEAREST {
        #repeat n 4
        v$n = read_nearest(p + $nu * PIXELS, q, origin);
        #end
    } else {
        #repeat n 4
        v$n = read_same(p + $nu * PIXELS, q, origin);
        #end
    }
    workgroupBarrier();
    #repeat n 4
    put(p + $nu * PIXELS, own, v$n);
    #end
    workgroupBarrier();
}
