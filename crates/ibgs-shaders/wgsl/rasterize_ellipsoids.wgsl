//! Opaque ellipsoids.
#set render
#stage blend
// Every Gaussian as an opaque ellipsoid with a hard edge, darker towards it. Of those that cover a pixel the first of its tile's
// list shows: the one whose centre is nearest. One workgroup a tile, one thread a pixel.
#import frame
#import tile
#import tile_order

@group(0) @binding(0) var<storage, read> projected: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> sorted_gaussians: array<u32>;
@group(0) @binding(2) var<storage, read> tile_ranges: array<u32>;
@group(0) @binding(3) var<storage, read_write> image: array<f32>;

@compute @workgroup_size(TILE, TILE)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_id) lid: vec3<u32>) {
    let tile = tile_of(wid);
    let pixel = corner_of(tile) + lid.xy;
    if any(pixel >= frame.size) {
        return;
    }
    let end = tile_ranges[2u * tile + 1u];
    var color = frame.background;
    for (var k = tile_ranges[2u * tile]; k < end; k++) {
        let g = sorted_gaussians[k];
        let a = projected[3u * g];
        let b = projected[3u * g + 1u];
        let power = falloff(a.xy - vec2<f32>(pixel), vec3(a.zw, b.x));
        // A list holds a Gaussian as far as its alpha reaches 1/255, so a faint one is smaller.
        if power < ELLIPSOID_POWER && b.y * exp(-power) >= ALPHA_MIN {
            color = projected[3u * g + 2u].rgb * mix(ELLIPSOID_EDGE, 1.0, sqrt(1.0 - power / ELLIPSOID_POWER));
            break;
        }
    }
    let p = pixel.y * frame.size.x + pixel.x;
    image[3u * p] = color.r;
    image[3u * p + 1u] = color.g;
    image[3u * p + 2u] = color.b;
}
