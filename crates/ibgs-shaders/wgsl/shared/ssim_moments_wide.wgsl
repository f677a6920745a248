// Windowed means of a tile for SSIM, forward, by a workgroup. The kernel fills `values`, by `halo_place`, with (x, y) of the tile and its
// halo, less a shift.
#import ssim_threads

// Then sums along the rows, as in `Means`: first of x and y, from ROW_SUMS on of their squares.
var<workgroup> values: array<vec2<f32>, 2u * ROW_SUMS>;
const_assert PITCH * SIDE <= 2u * ROW_SUMS;
var<workgroup> xy_rows: array<f32, ROW_SUMS>;

// The means over the windows of the thread's pixels. Every thread calls it.
fn windowed_means(local: u32) -> array<Means, 2> {
    workgroupBarrier();
    var rows: array<Means, 4>;
    if has_row(local) {
        let base = row_place(local);
        #repeat i 14
        {
            let v = values[base + $iu];
            let own = vec4(v, v * v);
            let xy = v.x * v.y;
            #repeat k 4
            if clamp($i - $k, 0, 10) == $i - $k {
                rows[$k].own += SSIM_WINDOW[clamp($i - $k, 0, 10)] * own;
                rows[$k].xy += SSIM_WINDOW[clamp($i - $k, 0, 10)] * xy;
            }
            #end
        }
        #end
    }
    workgroupBarrier();
    if has_row(local) {
        let base = row_sum_place(local);
        #repeat k 4
        values[base + 4u * $ku] = rows[$k].own.xy;
        values[ROW_SUMS + base + 4u * $ku] = rows[$k].own.zw;
        xy_rows[base + 4u * $ku] = rows[$k].xy;
        #end
    }
    workgroupBarrier();
    var means: array<Means, 2>;
    #repeat j 12
    {
        let at = local + $ju / 2u * TILE + $ju % 2u * ODD_ROWS;
        let own = vec4(values[at], values[ROW_SUMS + at]);
        let xy = xy_rows[at];
        #repeat k 2
        if clamp($j - $k, 0, 10) == $j - $k {
            means[$k].own += SSIM_WINDOW[clamp($j - $k, 0, 10)] * own;
            means[$k].xy += SSIM_WINDOW[clamp($j - $k, 0, 10)] * xy;
        }
        #end
    }
    #end
    return means;
}
