// One workgroup a tile and channel: gradient of the L1 + SSIM loss by the image, times the upstream scalar.
#import ssim

@group(0) @binding(0) var<storage, read> image: array<f32>;
@group(0) @binding(1) var<storage, read> photo: array<u32>;
@group(0) @binding(2) var<storage, read> moments: array<f32>;
@group(0) @binding(3) var<storage, read> v_loss: array<f32>;
@group(0) @binding(4) var<storage, read_write> v_image: array<f32>;

var<workgroup> maps: array<f32, 3u * SIDE * SIDE>;
var<workgroup> rows: array<f32, 3u * SIDE * TILE>;

@compute @workgroup_size(TILE, TILE)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(local_invocation_id) lid: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let c = wid.z;
    let plane = params.size.x * params.size.y;
    for (var k = local; k < SIDE * SIDE; k += TILE * TILE) {
        let p = halo_pixel(wid.xy, k);
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
            rows[m * SIDE * TILE + k] = sum;
        }
    }
    workgroupBarrier();
    let pixel = wid.xy * TILE + lid.xy;
    if any(pixel >= params.size) {
        return;
    }
    var s = vec3(0.0);
    for (var j = 0u; j < 2u * RADIUS + 1u; j++) {
        for (var m = 0u; m < 3u; m++) {
            s[m] += SSIM_WINDOW[j] * rows[m * SIDE * TILE + (lid.y + j) * TILE + lid.x];
        }
    }
    let p = pixel.y * params.size.x + pixel.x;
    let texel = photo[p];
    var v = 0.0;
    if photo_valid(texel) {
        let x = image[3u * p + c];
        let y = photo_channel(texel, c);
        let by_ssim = s.x + 2.0 * x * s.y + y * s.z;
        v = v_loss[0] * ((1.0 - params.lambda) * sign(x - y) - params.lambda * by_ssim) / (3.0 * f32(plane));
    }
    v_image[3u * p + c] = v;
}
