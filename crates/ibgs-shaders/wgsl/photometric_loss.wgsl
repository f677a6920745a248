#set train

#kernel photometric_loss
//! SSIM of a photo and the images warped to it, forward, one visible source.
#stage photometric loss
// One workgroup a tile and channel of one of the visible sources: SSIM of the photo y and of x, the warped image where it
// counts and the photo elsewhere, summed over the pixels that count, and the derivatives of SSIM by its windowed moments. A
// pixel counts where that source is there, its depth agrees, and the photo is valid there. A masked part of the photo is
// treated as the outside of the image: both are zero there.
#import ssim_moments
#import seen

/// [V, P, 4]: colour and cosine.
@group(0) @binding(0) var<storage, read> warped: array<f32>;
@group(0) @binding(1) var<storage, read> seen: array<u32>;
@group(0) @binding(2) var<storage, read> photo: array<u32>;
/// Nine planes: for each channel dSSIM/d(mu_x), /d(E[x x]), /d(E[x y]); zero where the pixel does not count.
@group(0) @binding(3) var<storage, read_write> moments: array<f32>;
/// (sum of 1 - SSIM, pixels that count) of each workgroup, source by source.
@group(0) @binding(4) var<storage, read_write> partials: array<vec2<f32>>;

#if NARROW
#import total

@compute @workgroup_size(LANES)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(subgroup_invocation_id) lane: u32) {
    let c = wid.z;
    let plane = params.size.x * params.size.y;
    let shift = moment_shift(wid.xy, c);
    var sum = vec2(0.0);
    for (var row = 0u; row < SIDE; row++) {
        #repeat k 4
        {
            let p = column_pixel(wid.xy, $ku, row, lane);
            let texel = photo[p];
            let y = photo_channel(texel, c);
            let warped_color = warped[4u * (params.visible_index * plane + p) + c];
            let x = select(y, warped_color, seen_agrees(seen[p], params.visible_index));
            let is_there = is_inside(wid.xy, $ku, row, lane) && photo_valid(texel);
            values[$k] = select(vec2(0.0), vec2(x, y), is_there) - shift;
        }
        #end
        add_row(lane);
        #repeat h 2
        if is_complete(wid.xy, $hu, row, lane) {
            let p = complete_pixel(wid.xy, $hu, row, lane);
            var derivatives = SsimDerivatives(0.0, 0.0, 0.0, 0.0);
            if photo_valid(photo[p]) && seen_agrees(seen[p], params.visible_index) {
                derivatives = ssim_derivatives(Means(own_sums[11 * $h], xy_sums[11 * $h]), shift);
                sum += vec2(1.0 - derivatives.ssim, 1.0);
            }
            store_derivatives(c, p, derivatives);
        }
        #end
    }
    let all = vec2(total(sum.x, lane), total(sum.y, lane));
    if lane == 0u {
        partials[((3u * params.visible_index + c) * params.tiles.y + wid.y) * params.tiles.x + wid.x] = all;
    }
}
#else
#import reduce_tile

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
    #if SUBGROUPS
    @builtin(subgroup_id) subgroup: u32,
    @builtin(subgroup_invocation_id) lane: u32,
    #endif
) {
    #if SUBGROUPS
    #else
    const subgroup = 0u;
    const lane = 0u;
    #endif
    let c = wid.z;
    let plane = params.size.x * params.size.y;
    #repeat i 6
    let k$i = local + $iu * THREADS;
    let p$i = halo_pixel(wid.xy, k$i);
    let at$i = u32(max(p$i, 0));
    let texel$i = photo[at$i];
    let seen$i = seen[at$i];
    let warped$i = warped[4u * (params.visible_index * plane + at$i) + c];
    #end
    let shift = moment_shift(wid.xy, c);
    #repeat i 6
    if k$i < SIDE * SIDE {
        let y$i = photo_channel(texel$i, c);
        let x$i = select(y$i, warped$i, seen_agrees(seen$i, params.visible_index));
        values[halo_place(k$i)] = select(vec2(0.0), vec2(x$i, y$i), p$i >= 0 && photo_valid(texel$i)) - shift;
    }
    #end
    let means = windowed_means(local);
    var result = vec2(0.0);
    let pixel = upper_pixel(wid.xy, local);
    #repeat h 2
    if pixel.x < params.size.x && pixel.y + $hu < params.size.y {
        let p = (pixel.y + $hu) * params.size.x + pixel.x;
        var derivatives = SsimDerivatives(0.0, 0.0, 0.0, 0.0);
        if photo_valid(photo[p]) && seen_agrees(seen[p], params.visible_index) {
            derivatives = ssim_derivatives(means[$h], shift);
            result += vec2(1.0 - derivatives.ssim, 1.0);
        }
        store_derivatives(c, p, derivatives);
    }
    #end
    let sum = reduce_tile(local, subgroup, lane, vec4(result, 0.0, 0.0));
    if local == 0u {
        partials[((3u * params.visible_index + c) * params.tiles.y + wid.y) * params.tiles.x + wid.x] = sum.xy;
    }
}
#endif

#kernel photometric_loss_backward
//! SSIM of a photo and the images warped to it, gradient by the warped colours, one visible source.
#stage photometric loss backward
// One workgroup a tile and channel of one of the visible sources: gradient of the photometric loss by the warped colours, times the
// upstream scalar; zero where a pixel does not count. The cosine beside the colour has none.
#import ssim_maps
#import seen

@group(0) @binding(0) var<storage, read> warped: array<f32>;
@group(0) @binding(1) var<storage, read> seen: array<u32>;
@group(0) @binding(2) var<storage, read> photo: array<u32>;
@group(0) @binding(3) var<storage, read> moments: array<f32>;
/// (loss, pixels and channels that count in all of them).
@group(0) @binding(4) var<storage, read> stats: array<f32>;
@group(0) @binding(5) var<storage, read> v_loss: array<f32>;
@group(0) @binding(6) var<storage, read_write> v_warped: array<f32>;

// Gradient by channel c of pixel p, from the windowed sums of the derivatives.
fn store_gradient(c: u32, p: u32, s: vec3<f32>) {
    let at = 4u * (params.visible_index * params.size.x * params.size.y + p) + c;
    let texel = photo[p];
    var v = 0.0;
    if photo_valid(texel) && seen_agrees(seen[p], params.visible_index) {
        let by_ssim = s.x + 2.0 * warped[at] * s.y + photo_channel(texel, c) * s.z;
        v = -v_loss[0] * params.lambda * by_ssim / stats[1];
    }
    v_warped[at] = v;
    if c == 2u {
        v_warped[at + 1u] = 0.0;
    }
}

#if NARROW
@compute @workgroup_size(LANES)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(subgroup_invocation_id) lane: u32) {
    for (var row = 0u; row < SIDE; row++) {
        add_maps(wid.xy, wid.z, row, lane);
        #repeat h 2
        if is_complete(wid.xy, $hu, row, lane) {
            store_gradient(wid.z, complete_pixel(wid.xy, $hu, row, lane), sums[11 * $h]);
        }
        #end
    }
}
#else
@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let c = wid.z;
    load_maps(wid.xy, c, local);
    let sums = window_sums(local);
    let pixel = upper_pixel(wid.xy, local);
    #repeat h 2
    if pixel.x < params.size.x && pixel.y + $hu < params.size.y {
        store_gradient(c, (pixel.y + $hu) * params.size.x + pixel.x, sums[$h]);
    }
    #end
}
#endif
