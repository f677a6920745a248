// By a subgroup a tile: the lanes exchange the columns of a row for the sums along it, and these go at once into the means of the eleven
// rows whose windows have it.
#import ssim_columns

// (x, y) of the row's columns, less the shift.
var<private> values: array<vec2<f32>, COLUMNS>;
// [half of the tile][rows until the window is complete], as in `Means`.
var<private> own_sums: array<vec4<f32>, 22>;
var<private> xy_sums: array<f32, 22>;

// Adds the row in `values`. Then the means of the row RADIUS above are complete.
fn add_row(lane: u32) {
    var own: array<vec4<f32>, 2>;
    var xy: array<f32, 2>;
    #repeat t 11
    {
        let other = (lane + $tu) % LANES;
        let is_near = lane + $tu % LANES < LANES;
        let first = subgroupShuffle(values[$tu / LANES], other);
        let second = subgroupShuffle(values[$tu / LANES + 1u], other);
        let third = subgroupShuffle(values[$tu / LANES + 2u], other);
        let v_0 = select(second, first, is_near);
        let v_1 = select(third, second, is_near);
        #repeat h 2
        {
            let weighed = SSIM_WINDOW[$t] * v_$h;
            own[$h] += vec4(weighed, weighed * v_$h);
            xy[$h] += weighed.x * v_$h.y;
        }
        #end
    }
    #end
    #repeat h 2
    #repeat k 10
    own_sums[11 * $h + $k] = own_sums[11 * $h + $k + 1] + SSIM_WINDOW[10 - $k] * own[$h];
    xy_sums[11 * $h + $k] = xy_sums[11 * $h + $k + 1] + SSIM_WINDOW[10 - $k] * xy[$h];
    #end
    own_sums[11 * $h + 10] = SSIM_WINDOW[0] * own[$h];
    xy_sums[11 * $h + 10] = SSIM_WINDOW[0] * xy[$h];
    #end
}
