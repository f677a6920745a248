// By a thread a pixel.

var<workgroup> maps: array<f32, 3u * SIDE * SIDE>;
var<workgroup> map_rows: array<f32, 3u * SIDE * TILE>;

// Loads channel c of the tile with its halo and sums along the rows. Every thread calls it before `window_sums`.
fn load_maps(tile: vec2<u32>, c: u32, local: u32) {
    let plane = params.size.x * params.size.y;
    let first = 3u * c * plane;
    #repeat i 3
    let k$i = local + $iu * TILE * TILE;
    let p$i = halo_pixel(tile, k$i);
    let at$i = first + u32(max(p$i, 0));
    let read$i = vec3(moments[at$i], moments[at$i + plane], moments[at$i + (2u * plane)]);
    #end
    #repeat i 3
    if k$i < SIDE * SIDE {
        let value$i = select(vec3(0.0), read$i, p$i >= 0);
        #repeat m 3
        maps[$mu * SIDE * SIDE + k$i] = value$i[$m];
        #end
    }
    #end
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
