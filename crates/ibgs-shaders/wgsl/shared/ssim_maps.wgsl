// The three derivative maps of SSIM (the buffer `moments`, see ssim_moments) under the window once more, backward.
#import ssim

var<workgroup> maps: array<f32, 3u * SIDE * SIDE>;
var<workgroup> map_rows: array<f32, 3u * SIDE * TILE>;

// Loads channel c of the tile with its halo and sums along the rows. Every thread calls it before `window_sums`.
fn load_maps(tile: vec2<u32>, c: u32, local: u32) {
    let plane = params.size.x * params.size.y;
    for (var k = local; k < SIDE * SIDE; k += TILE * TILE) {
        let p = halo_pixel(tile, k);
        for (var m = 0u; m < 3u; m++) {
            var value = 0.0;
            if p >= 0 {
                value = moments[(3u * c + m) * plane + u32(p)];
            }
            maps[m * SIDE * SIDE + k] = value;
        }
    }
    workgroupBarrier();
    for (var k = local; k < SIDE * TILE; k += TILE * TILE) {
        let base = (k / TILE) * SIDE + k % TILE;
        for (var m = 0u; m < 3u; m++) {
            var sum = 0.0;
            for (var i = 0u; i < 2u * RADIUS + 1u; i++) {
                sum += SSIM_WINDOW[i] * maps[m * SIDE * SIDE + base + i];
            }
            map_rows[m * SIDE * TILE + k] = sum;
        }
    }
    workgroupBarrier();
}

fn window_sums(lid: vec3<u32>) -> vec3<f32> {
    var s = vec3(0.0);
    for (var j = 0u; j < 2u * RADIUS + 1u; j++) {
        for (var m = 0u; m < 3u; m++) {
            s[m] += SSIM_WINDOW[j] * map_rows[m * SIDE * TILE + (lid.y + j) * TILE + lid.x];
        }
    }
    return s;
}
