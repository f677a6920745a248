// What a workgroup of residual_conv_weights holds: inputs with their halo and gradients of a tile of 16 x 2 pixels.
#import residual_source

const CHANNELS: u32 = NETWORK_CHANNELS;
// Per channel 4 rows of 5 x 4 columns; one more against bank conflicts, as in v_tile.
var<workgroup> x_tile: array<array<vec4<f32>, 21>, CHANNELS>;
// [pixel][output quad].
var<workgroup> v_tile: array<array<vec4<f32>, 11>, 32>;

// Where a thread's values of the input tile lie in the source and go in the tile.
struct Place {
    inside: bool,
    first: u32,
    into: u32,
}

fn wanted(place: Place, c: u32) -> vec4<bool> {
    return vec4(place.inside) & (c + vec4(0u, 2u, 4u, 6u) < vec4(params.inputs));
}

// Four values, of every other channel from c on. Reads in any case, so that many reads can be under way at once.
fn four(place: Place, c: u32, shift: u32) -> vec4<f32> {
    let plane = params.source.x * params.source.y;
    let position = (c + vec4(0u, 2u, 4u, 6u)) * plane + place.first;
    let i = select(vec4(0u), position, wanted(place, c)) + shift;
    return vec4(input[i.x], input[i.y], input[i.z], input[i.w]);
}

fn four_pooled(place: Place, c: u32) -> vec4<f32> {
    let below = params.source.x;
    let upper = max(four(place, c, 0u), four(place, c, 1u));
    return max(upper, max(four(place, c, below), four(place, c, below + 1u)));
}

fn put(place: Place, c: u32, values: vec4<f32>) {
    let v = select(vec4(0.0), values, wanted(place, c));
    x_tile[c][place.into / 4u][place.into % 4u] = v.x;
    x_tile[c + 2u][place.into / 4u][place.into % 4u] = v.y;
    x_tile[c + 4u][place.into / 4u][place.into % 4u] = v.z;
    if c + 6u < CHANNELS {
        x_tile[c + 6u][place.into / 4u][place.into % 4u] = v.w;
    }
}

fn load_inputs(local: u32, corner: vec2<i32>) {
    let into = local % 80u;
    let column = into % 20u;
    let x = source_of(corner.x + i32(column) - 1, params.size.x, params.source.x, params.mode);
    let y = source_of(corner.y + i32(into / 20u) - 1, params.size.y, params.source.y, params.mode);
    let inside = x >= 0 && y >= 0 && column < 18u;
    let place = Place(inside, u32(y) * params.source.x + u32(x), into);
    let c = local / 80u;
    var t0: vec4<f32>;
    var t1: vec4<f32>;
    var t2: vec4<f32>;
    var t3: vec4<f32>;
    var t4: vec4<f32>;
    if params.mode == CONV_POOLED {
        t0 = four_pooled(place, c);
        t1 = four_pooled(place, c + 8u);
        t2 = four_pooled(place, c + 16u);
        t3 = four_pooled(place, c + 24u);
        t4 = four_pooled(place, c + 32u);
    } else {
        t0 = four(place, c, 0u);
        t1 = four(place, c + 8u, 0u);
        t2 = four(place, c + 16u, 0u);
        t3 = four(place, c + 24u, 0u);
        t4 = four(place, c + 32u, 0u);
    }
    put(place, c, t0);
    put(place, c + 8u, t1);
    put(place, c + 16u, t2);
    put(place, c + 24u, t3);
    put(place, c + 32u, t4);
}

// Reads in any case, so that many reads can be under way at once.
fn gradient(inside: bool, o: u32, at: u32) -> f32 {
    let wanted = inside && o < params.outputs;
    return select(0.0, v[select(0u, o * params.size.x * params.size.y + at, wanted)], wanted);
}

// Four outputs of one pixel.
fn gradients(o: u32, x: u32, y: u32) -> vec4<f32> {
    let inside = x < params.size.x && y < params.size.y;
    let at = y * params.size.x + x;
    return vec4(
        gradient(inside, o, at),
        gradient(inside, o + 1u, at),
        gradient(inside, o + 2u, at),
        gradient(inside, o + 3u, at),
    );
}
