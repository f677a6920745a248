// By a workgroup.
#import ssim_threads

// The maps of the tile with its halo, then their sums along the rows.
var<workgroup> maps: array<vec2<f32>, PITCH * SIDE>;
var<workgroup> third_map: array<f32, PITCH * SIDE>;

// Loads channel c of the tile with its halo and sums along the rows. Every thread calls it before `window_sums`.
fn load_maps(tile: vec2<u32>, c: u32, local: u32) {
    let plane = params.size.x * params.size.y;
    let first = 3u * c * plane;
    #repeat i 6
    let k$i = local + $iu * THREADS;
    let p$i = halo_pixel(tile, k$i);
    let at$i = first + u32(max(p$i, 0));
    let read$i = vec3(moments[at$i], moments[at$i + plane], moments[at$i + (2u * plane)]);
    #end
    #repeat i 6
    if k$i < SIDE * SIDE {
        let value$i = select(vec3(0.0), read$i, p$i >= 0);
        maps[halo_place(k$i)] = value$i.xy;
        third_map[halo_place(k$i)] = value$i.z;
    }
    #end
    workgroupBarrier();
    var rows: array<vec3<f32>, 4>;
    if has_row(local) {
        let base = row_place(local);
        #repeat i 14
        {
            let value = vec3(maps[base + $iu], third_map[base + $iu]);
            #repeat k 4
            if clamp($i - $k, 0, 10) == $i - $k {
                rows[$k] += SSIM_WINDOW[clamp($i - $k, 0, 10)] * value;
            }
            #end
        }
        #end
    }
    workgroupBarrier();
    if has_row(local) {
        let base = row_sum_place(local);
        #repeat k 4
        maps[base + 4u * $ku] = rows[$k].xy;
        third_map[base + 4u * $ku] = rows[$k].z;
        #end
    }
    workgroupBarrier();
}

// Of the thread's pixels.
fn window_sums(local: u32) -> array<vec3<f32>, 2> {
    var sums: array<vec3<f32>, 2>;
    #repeat j 12
    {
        let at = local + $ju / 2u * TILE + $ju % 2u * ODD_ROWS;
        let value = vec3(maps[at], third_map[at]);
        #repeat k 2
        if clamp($j - $k, 0, 10) == $j - $k {
            sums[$k] += SSIM_WINDOW[clamp($j - $k, 0, 10)] * value;
        }
        #end
    }
    #end
    return sums;
}
