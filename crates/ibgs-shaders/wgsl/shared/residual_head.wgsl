// The two 1 x 1 convolutions at the U-Net's end: f = relu(fuse [d1, x]) and the network's output, linear in f. A thread owns
// four pixels; 38 channels are ten quads.

struct HeadParams {
    pixels: u32,
    // First weight and first bias of the two layers.
    fuse: u32,
    fuse_bias: u32,
    last: u32,
    last_bias: u32,
    // 1: f is kept for the backward pass.
    keep: u32,
}

var<immediate> params: HeadParams;

const WIDTH: u32 = NETWORK_CHANNELS;
const INPUTS: u32 = 2u * WIDTH;
const OUTPUTS: u32 = NETWORK_OUTPUTS;
