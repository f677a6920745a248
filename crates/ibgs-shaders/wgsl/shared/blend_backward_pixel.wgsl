// What the gradients of blend.wgsl need of a pixel, whose list entries it visits back to front. An entry's gradients are sums over
// the pixels of w = alpha T and q = dL/d(falloff) negated, times numbers of the pixel. INTERSECTIONS: with the gradients of the
// normal map, the median depth and the median intersections. Where a pixel's list entry is one of its K intersections, a third
// number joins w and q: h = -dL/dz z^2 / D, by which the ray times the pixel adds to the plane's normal. Departs from the published
// code (method.md 10.2): the weights of the intersections know the transmittance in front of them.

const PIXELS: u32 = TILE * TILE;
// Vectors of an entry: the projected row and, for the surface, the plane.
#if INTERSECTIONS
const ENTRY: u32 = 4u;
#else
const ENTRY: u32 = 3u;
#endif

struct Pixel {
    // Its number in the image.
    index: u32,
    at: vec2<f32>,
    // Transmittance behind the current entry, and the last entry that counted.
    t: f32,
    last: u32,
    // dL/d(weight) times the weights behind the current entry, and the background.
    behind: f32,
    // Gradient of the colour.
    v: vec3<f32>,
    #if INTERSECTIONS
    // Gradient of the normal map.
    v_normal: vec3<f32>,
    median: f32,
    // dL/d(median depth) over the sum of the weights.
    v_median: f32,
    // Intersections from here on are done. `next` is the entry of the one before, `intersection` its depth and weight and
    // `v_intersection` the gradient by them, read long before they are wanted; `entries` are those before it, last first.
    cursor: u32,
    next: u32,
    intersection: vec2<f32>,
    v_intersection: vec2<f32>,
    entries: array<vec4<u32>, 2>,
    #endif
}

// w, q and, for the surface, h.
struct Visit {
    w: f32,
    q: f32,
    #if INTERSECTIONS
    h: f32,
    #endif
}

var<workgroup> deepest: atomic<u32>;
var<workgroup> deepest_now: u32;

// Entries that some pixel of the tile reached. Every thread calls it, in uniform control flow.
fn deepest_entry(local: u32, last: u32) -> u32 {
    if local == 0u {
        atomicStore(&deepest, 0u);
    }
    workgroupBarrier();
    atomicMax(&deepest, last);
    workgroupBarrier();
    if local == 0u {
        deepest_now = atomicLoad(&deepest);
    }
    return workgroupUniformLoad(&deepest_now);
}

// The vector of a chunk's entries that a thread loads.
fn load_entry(local: u32, first: u32, start: u32, length: u32) -> vec4<f32> {
    let g = sorted_gaussians[start + min(first + local / ENTRY, length - 1u)];
    #if INTERSECTIONS
    if local % ENTRY == 3u {
        return planes[g];
    }
    #endif
    return projected[3u * g + local % ENTRY];
}

#if INTERSECTIONS
fn next_intersection(pixel: ptr<function, Pixel>) {
    (*pixel).next = NO_ENTRY;
    while (*pixel).cursor > 0u && (*pixel).next == NO_ENTRY {
        (*pixel).cursor--;
        let near = (*pixel).entries[0];
        let far = (*pixel).entries[1];
        (*pixel).next = near.x;
        (*pixel).entries[0] = vec4(near.yzw, far.x);
        (*pixel).entries[1] = vec4(far.yzw, NO_ENTRY);
    }
    if (*pixel).next != NO_ENTRY {
        let at = (*pixel).cursor * frame.size.x * frame.size.y + (*pixel).index;
        (*pixel).intersection = intersections[at];
        (*pixel).v_intersection = v_intersections[at];
    }
}

// The entry of the intersection that is `back` from the last.
fn entry_from_the_last(p: u32, back: u32) -> u32 {
    let plane_size = frame.size.x * frame.size.y;
    let at = (max(frame.intersections, back + 1u) - 1u - back) * plane_size + p;
    return select(NO_ENTRY, intersection_entries[at], back < frame.intersections);
}
#endif

fn load_pixel(at: vec2<u32>) -> Pixel {
    var pixel: Pixel;
    let p = at.y * frame.size.x + at.x;
    pixel.index = p;
    pixel.at = vec2<f32>(at);
    pixel.t = 1.0;
    #if INTERSECTIONS
    pixel.next = NO_ENTRY;
    #endif
    if all(at < frame.size) {
        pixel.t = final_t[p];
        pixel.last = last_entry[p];
        pixel.v = vec3(v_image[3u * p], v_image[3u * p + 1u], v_image[3u * p + 2u]);
        #if INTERSECTIONS
        let plane_size = frame.size.x * frame.size.y;
        pixel.v_normal = vec3(v_normal_map[3u * p], v_normal_map[3u * p + 1u], v_normal_map[3u * p + 2u]);
        pixel.median = median_depth[p];
        var weights = SURFACE_EPSILON;
        for (var k = 0u; k < frame.intersections; k++) {
            weights += intersections[k * plane_size + p].y;
        }
        pixel.v_median = v_median_depth[p] / weights;
        pixel.cursor = frame.intersections;
        #repeat k 4
        pixel.entries[0][$k] = entry_from_the_last(p, $ku);
        pixel.entries[1][$k] = entry_from_the_last(p, 4u + $ku);
        #end
        next_intersection(&pixel);
        #endif
    }
    pixel.behind = pixel.t * dot(frame.background, pixel.v);
    return pixel;
}

// The pixel's numbers for entry `k` of its tile's list, of which `a`, `b`, `c` and `plane` are the vectors.
#if INTERSECTIONS
fn visit(pixel: ptr<function, Pixel>, k: u32, a: vec4<f32>, b: vec4<f32>, c: vec4<f32>, plane: vec4<f32>) -> Visit {
#else
fn visit(pixel: ptr<function, Pixel>, k: u32, a: vec4<f32>, b: vec4<f32>, c: vec4<f32>) -> Visit {
#endif
    var out: Visit;
    let raw = b.y * exp(-falloff(a.xy - (*pixel).at, vec3(a.zw, b.x)));
    let reached = min(ALPHA_MAX, raw);
    // An entry that does not count has no alpha, and changes nothing.
    let counts = (k < (*pixel).last) & (reached >= ALPHA_MIN);
    let alpha = select(0.0, reached, counts);
    let over_pass = 1.0 / (1.0 - alpha);
    let t = (*pixel).t * over_pass;
    (*pixel).t = t;
    out.w = alpha * t;
    var v_weight = dot(c.rgb, (*pixel).v);
    #if INTERSECTIONS
    v_weight += dot(plane.xyz, (*pixel).v_normal);
    if (*pixel).next == k {
        let intersection = (*pixel).intersection;
        let v_intersection = (*pixel).v_intersection;
        v_weight += v_intersection.y + (*pixel).v_median * (intersection.x - (*pixel).median);
        let v_z = v_intersection.x + (*pixel).v_median * intersection.y;
        out.h = -v_z * intersection.x * intersection.x / plane.w;
        next_intersection(pixel);
    }
    #endif
    out.q = select(0.0, alpha * (t * v_weight - (*pixel).behind * over_pass), raw <= ALPHA_MAX);
    (*pixel).behind += out.w * v_weight;
    return out;
}
