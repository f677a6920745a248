// What all kernels of the residual network's input share (method.md section 6). Reads the kernel's binding most_visible:
// its first number is that of the visible sources of the pixel that has most.
#import residual_image
#import resize
#import seen

/// Input of the residual network.
struct FeatureParams {
    /// Rows of R with `x_view = R x_world + t`; the fourth number is not used.
    row0: vec4<f32>,
    /// Second row.
    row1: vec4<f32>,
    /// Third row.
    row2: vec4<f32>,
    /// Focal lengths in pixels.
    focal: vec2<f32>,
    /// Principal point minus one half: the pixel with index x lies at x.
    principal: vec2<f32>,
    /// Image size in pixels.
    size: vec2<u32>,
    /// Size at which the network runs.
    low: vec2<u32>,
    /// Visible sources a pixel, at most four.
    visible: u32,
    /// An [`crate::Aggregation`].
    aggregation: u32,
    /// Workgroups of the backward pass.
    groups: u32,
    /// Inverse of the scale of gradients in half precision.
    unscale: f32,
    /// An [`crate::Output`].
    output: u32,
    /// First of the three planes of the gradient by the base colour.
    base_plane: u32,
    /// Padding.
    pad: vec2<u32>,
}

var<immediate> params: FeatureParams;

// Channels of the U-Net's input: aggregated features, ray, base colour.
const RAY_CHANNEL: u32 = MLP_CHANNELS;

// Visible sources of the pixel that has most.
fn used_sources() -> u32 {
    return min(most_visible[0], params.visible);
}
