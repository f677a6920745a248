//! Adds up a gradient by a camera.
#set train
#stage other
// One workgroup: adds the workgroups' sums of camera_sums.wgsl to a camera's gradient.
#import reduce

/// Which sums, and of which camera.
struct CameraTotalParams {
    /// Rows of a workgroup's sums.
    stride: u32,
    /// The first that counts.
    first: u32,
    /// Camera that they are of: 0 the target's, then the sources'.
    camera: u32,
    /// Unused.
    pad: u32,
}

var<immediate> params: CameraTotalParams;

@group(0) @binding(0) var<storage, read> partials: array<vec4<f32>>;
/// Three rows a camera: (translation, focal x), (rotation, focal y), (principal point, 0, 0).
@group(0) @binding(1) var<storage, read_write> v_cameras: array<vec4<f32>>;

const THREADS: u32 = CAMERA_GROUPS;

@compute @workgroup_size(THREADS)
fn main(@builtin(local_invocation_index) local: u32) {
    for (var row = 0u; row < 3u; row++) {
        let total = reduce(local, partials[params.stride * local + params.first + row]);
        if local == 0u {
            v_cameras[3u * params.camera + row] += total;
        }
    }
}
