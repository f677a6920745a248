#set train

#kernel image_loss
//! L1 + SSIM, forward.
#stage image loss
// One workgroup a tile and channel: |x - y|, SSIM, and the derivatives of SSIM by its windowed moments.
#import ssim_moments

@group(0) @binding(0) var<storage, read> image: array<f32>;
@group(0) @binding(1) var<storage, read> photo: array<u32>;
/// Nine planes: for each channel dSSIM/d(mu_x), /d(E[x x]), /d(E[x y]).
@group(0) @binding(2) var<storage, read_write> moments: array<f32>;
/// (sum |x - y|, sum SSIM, sum of squared errors of the clamped image, 0) of each workgroup.
@group(0) @binding(3) var<storage, read_write> partials: array<vec4<f32>>;

#if NARROW
#import total

@compute @workgroup_size(LANES)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(subgroup_invocation_id) lane: u32) {
    let c = wid.z;
    let shift = moment_shift(wid.xy, c);
    var sum = vec3(0.0);
    for (var row = 0u; row < SIDE; row++) {
        #repeat k 4
        {
            let p = column_pixel(wid.xy, $ku, row, lane);
            let x = image[3u * p + c];
            let texel = photo[p];
            let y = select(x, target_channel(texel, c), target_counts(texel));
            let is_there = is_inside(wid.xy, $ku, row, lane);
            values[$k] = select(vec2(0.0), vec2(x, y), is_there) - shift;
            let error = clamp(x, 0.0, 1.0) - clamp(y, 0.0, 1.0);
            let is_own = is_there && is_of_tile($ku, row, lane);
            sum += select(vec3(0.0), vec3(abs(values[$k].x - values[$k].y), 0.0, error * error), is_own);
        }
        #end
        add_row(lane);
        #repeat h 2
        if is_complete(wid.xy, $hu, row, lane) {
            let derivatives = ssim_derivatives(Means(own_sums[11 * $h], xy_sums[11 * $h]), shift);
            store_derivatives(c, complete_pixel(wid.xy, $hu, row, lane), derivatives);
            sum.y += derivatives.ssim;
        }
        #end
    }
    let all = vec4(total(sum.x, lane), total(sum.y, lane), total(sum.z, lane), 0.0);
    if lane == 0u {
        partials[(wid.z * params.tiles.y + wid.y) * params.tiles.x + wid.x] = all;
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
    #repeat i 6
    let k$i = local + $iu * THREADS;
    let p$i = halo_pixel(wid.xy, k$i);
    let x$i = image[3u * u32(max(p$i, 0)) + c];
    let texel$i = photo[max(p$i, 0)];
    #end
    let shift = moment_shift(wid.xy, c);
    var result = vec4(0.0);
    #repeat i 6
    if k$i < SIDE * SIDE {
        let y$i = select(x$i, target_channel(texel$i, c), target_counts(texel$i));
        values[halo_place(k$i)] = select(vec2(0.0), vec2(x$i, y$i), p$i >= 0) - shift;
        let error$i = clamp(x$i, 0.0, 1.0) - clamp(y$i, 0.0, 1.0);
        let is_own$i = p$i >= 0 && all(vec2(k$i % SIDE, k$i / SIDE) - RADIUS < vec2(TILE));
        result += select(vec4(0.0), vec4(abs(x$i - y$i), 0.0, error$i * error$i, 0.0), is_own$i);
    }
    #end
    let means = windowed_means(local);
    let pixel = upper_pixel(wid.xy, local);
    #repeat h 2
    if pixel.x < params.size.x && pixel.y + $hu < params.size.y {
        let derivatives = ssim_derivatives(means[$h], shift);
        store_derivatives(c, (pixel.y + $hu) * params.size.x + pixel.x, derivatives);
        result.y += derivatives.ssim;
    }
    #end
    let sum = reduce_tile(local, subgroup, lane, result);
    if local == 0u {
        partials[(wid.z * params.tiles.y + wid.y) * params.tiles.x + wid.x] = sum;
    }
}
#endif

#kernel image_loss_total
//! L1 + SSIM, sum over the tiles.
#stage image loss
// One workgroup: sums the tiles' partial sums in a fixed order. stats = (loss, mean |x - y|, mean SSIM, mean squared error).
#import ssim
#import reduce

@group(0) @binding(0) var<storage, read> partials: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read_write> loss: array<f32>;
@group(0) @binding(2) var<storage, read_write> stats: array<f32>;

const THREADS: u32 = 256u;

@compute @workgroup_size(THREADS)
fn main(@builtin(local_invocation_index) local: u32) {
    let count = 3u * params.tiles.x * params.tiles.y;
    var sum = vec4(0.0);
    for (var i = local; i < count; i += THREADS) {
        sum += partials[i];
    }
    let total = reduce(local, sum);
    if local == 0u {
        let mean = total / (3.0 * f32(params.size.x * params.size.y));
        let value = (1.0 - params.lambda) * mean.x + params.lambda * (1.0 - mean.y);
        loss[0] = value;
        stats[0] = value;
        stats[1] = mean.x;
        stats[2] = mean.y;
        stats[3] = mean.z;
    }
}

#kernel image_loss_backward
//! L1 + SSIM, gradient by the image.
#stage image loss backward
// One workgroup a tile and channel: gradient of the L1 + SSIM loss by the image, times the upstream scalar.
#import ssim_maps

@group(0) @binding(0) var<storage, read> image: array<f32>;
@group(0) @binding(1) var<storage, read> photo: array<u32>;
@group(0) @binding(2) var<storage, read> moments: array<f32>;
@group(0) @binding(3) var<storage, read> v_loss: array<f32>;
@group(0) @binding(4) var<storage, read_write> v_image: array<f32>;

// Gradient by channel c of a pixel, which is x, from the windowed sums of the derivatives.
fn by_image(texel: u32, c: u32, x: f32, s: vec3<f32>, upstream: f32) -> f32 {
    if !target_counts(texel) {
        return 0.0;
    }
    let y = target_channel(texel, c);
    let by_ssim = s.x + 2.0 * x * s.y + y * s.z;
    let count = 3.0 * f32(params.size.x * params.size.y);
    return upstream * ((1.0 - params.lambda) * sign(x - y) - params.lambda * by_ssim) / count;
}

#if NARROW
@compute @workgroup_size(LANES)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(subgroup_invocation_id) lane: u32) {
    let c = wid.z;
    let upstream = v_loss[0];
    for (var row = 0u; row < SIDE; row++) {
        add_maps(wid.xy, c, row, lane);
        #repeat h 2
        if is_complete(wid.xy, $hu, row, lane) {
            let p = complete_pixel(wid.xy, $hu, row, lane);
            v_image[3u * p + c] = by_image(photo[p], c, image[3u * p + c], sums[11 * $h], upstream);
        }
        #end
    }
}
#else
@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let c = wid.z;
    let pixel = upper_pixel(wid.xy, local);
    // Read before the maps, so that all wait together.
    #repeat h 2
    let within$h = min(pixel + vec2(0u, $hu), params.size - 1u);
    let p$h = within$h.y * params.size.x + within$h.x;
    let texel$h = photo[p$h];
    let x$h = image[3u * p$h + c];
    #end
    let upstream = v_loss[0];
    load_maps(wid.xy, c, local);
    let sums = window_sums(local);
    #repeat h 2
    if pixel.x < params.size.x && pixel.y + $hu < params.size.y {
        v_image[3u * p$h + c] = by_image(texel$h, c, x$h, sums[$h], upstream);
    }
    #end
}
#endif
