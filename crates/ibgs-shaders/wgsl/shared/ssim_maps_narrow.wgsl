// By a subgroup a tile, as in ssim_moments_narrow.
#import ssim_columns

// The maps at the row's columns.
var<private> maps: array<vec3<f32>, COLUMNS>;
// [half of the tile][rows until the window is complete].
var<private> sums: array<vec3<f32>, 22>;

// Reads a row and adds it. Then the sums of the row RADIUS above are complete.
fn add_maps(tile: vec2<u32>, c: u32, row: u32, lane: u32) {
    let plane = params.size.x * params.size.y;
    #repeat k 4
    {
        let at = 3u * c * plane + column_pixel(tile, $ku, row, lane);
        let read = vec3(moments[at], moments[at + plane], moments[at + 2u * plane]);
        maps[$k] = select(vec3(0.0), read, is_inside(tile, $ku, row, lane));
    }
    #end
    var own: array<vec3<f32>, 2>;
    #repeat t 11
    {
        let other = (lane + $tu) % LANES;
        let is_near = lane + $tu % LANES < LANES;
        let first = subgroupShuffle(maps[$tu / LANES], other);
        let second = subgroupShuffle(maps[$tu / LANES + 1u], other);
        let third = subgroupShuffle(maps[$tu / LANES + 2u], other);
        own[0] += SSIM_WINDOW[$t] * select(second, first, is_near);
        own[1] += SSIM_WINDOW[$t] * select(third, second, is_near);
    }
    #end
    #repeat h 2
    #repeat k 10
    sums[11 * $h + $k] = sums[11 * $h + $k + 1] + SSIM_WINDOW[10 - $k] * own[$h];
    #end
    sums[11 * $h + 10] = SSIM_WINDOW[0] * own[$h];
    #end
}
