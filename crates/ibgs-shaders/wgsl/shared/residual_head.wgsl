// The two 1 x 1 convolutions at the U-Net's end: f = relu(fuse [d1, x]) and the network's output, linear in f. A thread owns
// four pixels; 38 channels are ten quads.

/// The U-Net's last two layers.
struct HeadParams {
    /// Number of pixels.
    pixels: u32,
    /// First weight of the layer before the last.
    fuse: u32,
    /// Its first bias.
    fuse_bias: u32,
    /// First weight of the last layer.
    last: u32,
    /// Its first bias.
    last_bias: u32,
    /// 1: the values between the two layers are kept.
    keep: u32,
}

var<immediate> params: HeadParams;

const WIDTH: u32 = NETWORK_CHANNELS;
const INPUTS: u32 = 2u * WIDTH;
const OUTPUTS: u32 = NETWORK_OUTPUTS;
