// The three derivative maps of SSIM (the buffer `moments`, see ssim_moments) under the window once more, backward.
#import ssim

var<workgroup> maps: array<f32, 3u * SIDE * SIDE>;
var<workgroup> map_rows: array<f32, 3u * SIDE * TILE>;

// Loads channel c of the tile with its halo and sums along the rows. Every thread calls it before `window_sums`.
fn load_maps(tile: vec2<u32>, c: u32, local: u32) {
    let plane = params.size.x * params.size.y;
    let first = 3u * c * plane;
    for (var k = local; k < SIDE * SIDE; k += TILE * TILE) {
        let p = halo_pixel(tile, k);
        var value = vec3(0.0);
        if p >= 0 {
            let at = first + u32(p);
            value = vec3(moments[at], moments[at + plane], moments[at + 2u * plane]);
        }
        #repeat m 3
        maps[$mu * SIDE * SIDE + k] = value[$m];
        #end
    }
    workgroupBarrier();
    for (var k = local; k < SIDE * TILE; k += TILE * TILE) {
        let base = (k / TILE) * SIDE + k % TILE;
        var sum = vec3(0.0);
        #repeat i 11
        sum += SSIM_WINDOW[$i]
            * vec3(maps[base + $iu], maps[SIDE * SIDE + base + $iu], maps[2u * SIDE * SIDE + base + $iu]);
        #end
        #repeat m 3
        map_rows[$mu * SIDE * TILE + k] = sum[$m];
        #end
    }
    workgroupBarrier();
}

fn window_sums(lid: vec3<u32>) -> vec3<f32> {
    var s = vec3(0.0);
    let base = lid.y * TILE + lid.x;
    #repeat j 11
    let at$j = base + $ju * TILE;
    s += SSIM_WINDOW[$j] * vec3(map_rows[at$j], map_rows[SIDE * TILE + at$j], map_rows[2u * SIDE * TILE + at$j]);
    #end
    return s;
}
