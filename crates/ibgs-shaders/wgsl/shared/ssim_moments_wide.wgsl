// Windowed means of a tile for SSIM, forward, by a thread a pixel. The kernel fills `values` with (x, y) of the tile and its halo, less
// a shift.
var<workgroup> values: array<vec2<f32>, SIDE * SIDE>;
// Sums along the rows, as in `Means`.
var<workgroup> own_rows: array<vec4<f32>, SIDE * TILE>;
var<workgroup> xy_rows: array<f32, SIDE * TILE>;

// The means over the window of the thread's pixel. Every thread calls it.
fn windowed_means(lid: vec2<u32>, local: u32) -> Means {
    workgroupBarrier();
    for (var k = local; k < SIDE * TILE; k += TILE * TILE) {
        let base = (k / TILE) * SIDE + k % TILE;
        var s = Means(vec4(0.0), 0.0);
        #repeat i 11
        let v$i = values[base + $iu];
        let weighed$i = SSIM_WINDOW[$i] * v$i;
        s.own += vec4(weighed$i, weighed$i * v$i);
        s.xy += weighed$i.x * v$i.y;
        #end
        own_rows[k] = s.own;
        xy_rows[k] = s.xy;
    }
    workgroupBarrier();
    var s = Means(vec4(0.0), 0.0);
    let at = lid.y * TILE + lid.x;
    #repeat j 11
    s.own += SSIM_WINDOW[$j] * own_rows[at + $ju * TILE];
    s.xy += SSIM_WINDOW[$j] * xy_rows[at + $ju * TILE];
    #end
    return s;
}
