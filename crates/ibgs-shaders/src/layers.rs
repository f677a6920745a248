//! Where each layer of the residual network lies in its flat weight vector (method.md section 6).

/// Numbers of the per-view feature in every network so far, the published one first. A new number comes last, and so does
/// the new width here: files of the others are read with zeros in place of the weights that they lack.
pub const WIDTHS: &[usize] = &[7];
/// Numbers of the per-view feature.
pub const FEATURES: usize = WIDTHS[WIDTHS.len() - 1];
/// Channels of the per-view MLP.
pub const HIDDEN: usize = 32;
/// Channels of the U-Net's input: aggregated features, unit viewing ray, base colour.
pub const INPUT: usize = HIDDEN + 6;
/// Channels of the output: the residual's three colours and the gate's one.
pub const OUTPUTS: usize = 4;
/// Channels of the residual.
pub const COLORS: usize = 3;
/// Channels at a half of the size.
pub const HALF: usize = INPUT / 2;
/// Channels at a quarter of the size.
pub const QUARTER: usize = HALF / 2;

/// A linear or convolution layer: weights `[outputs, inputs, taps]` (taps row by row: 9 for 3 x 3, 1 otherwise), then
/// `outputs` biases, from `offset` on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layer {
    /// Name in the published code's state dict, without `.weight` and `.bias`.
    pub name: &'static str,
    /// Output channels.
    pub outputs: usize,
    /// Input channels.
    pub inputs: usize,
    /// Channels of the two activations whose concatenation it reads; the second 0 where it reads one.
    pub read: [usize; 2],
    /// 9 or 1.
    pub taps: usize,
    /// First weight.
    pub offset: usize,
}

impl Layer {
    /// Number of weights, biases not counted.
    pub const fn weights(&self) -> usize {
        self.outputs * self.inputs * self.taps
    }

    /// First bias.
    pub const fn bias(&self) -> usize {
        self.offset + self.weights()
    }

    /// First value behind the layer.
    pub const fn end(&self) -> usize {
        self.bias() + self.outputs
    }

    /// Distance between the weights of neighbouring outputs.
    pub const fn row(&self) -> usize {
        self.inputs * self.taps
    }

    /// Its inputs by activation, as [`Layer::read`].
    pub const fn parts(&'static self) -> [Part; 2] {
        let [a, b] = self.read;
        [Part { layer: self, first: 0, channels: a }, Part { layer: self, first: a, channels: b }]
    }

    const fn new(name: &'static str, outputs: usize, inputs: usize, taps: usize, offset: usize) -> Self {
        Self::joining(name, outputs, [inputs, 0], taps, offset)
    }

    const fn joining(name: &'static str, outputs: usize, read: [usize; 2], taps: usize, offset: usize) -> Self {
        Self { name, outputs, inputs: read[0] + read[1], read, taps, offset }
    }
}

/// Those of a layer's inputs that come from one activation.
#[derive(Clone, Copy, Debug)]
pub struct Part {
    /// The layer.
    pub layer: &'static Layer,
    /// First of the inputs.
    pub first: usize,
    /// How many there are.
    pub channels: usize,
}

impl Part {
    /// First weight.
    pub const fn offset(&self) -> usize {
        self.layer.offset + self.layer.taps * self.first
    }
}

/// First layer of the per-view MLP.
pub const MLP1: Layer = Layer::new("per_view_mlp.0", HIDDEN, FEATURES, 1, 0);
/// Second layer of the per-view MLP.
pub const MLP2: Layer = Layer::new("per_view_mlp.2", HIDDEN, HIDDEN, 1, MLP1.end());
/// e1.
pub const ENC1: Layer = Layer::new("conv_decoder.enc1.0", INPUT, INPUT, 9, MLP2.end());
/// e2.
pub const ENC2: Layer = Layer::new("conv_decoder.enc2.0", HALF, INPUT, 9, ENC1.end());
/// b.
pub const ENC3: Layer = Layer::new("conv_decoder.enc3.0", QUARTER, HALF, 9, ENC2.end());
/// u2.
pub const UP2: Layer = Layer::new("conv_decoder.up2_conv.0", HALF, QUARTER, 9, ENC3.end());
/// d2, reads `[u2, e2]`.
pub const DEC2: Layer = Layer::joining("conv_decoder.dec2.0", HALF, [HALF; 2], 9, UP2.end());
/// u1.
pub const UP1: Layer = Layer::new("conv_decoder.up1_conv.0", INPUT, HALF, 9, DEC2.end());
/// d1, reads `[u1, e1]`.
pub const DEC1: Layer = Layer::joining("conv_decoder.dec1.0", INPUT, [INPUT; 2], 9, UP1.end());
/// f, reads `[d1, x]`.
pub const FUSE: Layer = Layer::joining("conv_decoder.fuse_input.0", INPUT, [INPUT; 2], 1, DEC1.end());
/// The output: the residual, and the gate of the sources' mean difference before its sigmoid. The published network has the
/// residual alone.
pub const FINAL: Layer = Layer::new("conv_decoder.final", OUTPUTS, INPUT, 1, FUSE.end());

/// The confidence in a source, from the first layer of the per-view MLP and the error of the source's depth; not in the published
/// network. Read with
/// [`Aggregation::Soft`](crate::Aggregation::Soft) alone.
pub const CONFIDENCE: Layer = Layer::new("per_view_confidence", 1, HIDDEN + 1, 1, FINAL.end());

/// Every layer in order.
pub const LAYERS: [Layer; 12] = [MLP1, MLP2, ENC1, ENC2, ENC3, UP2, DEC2, UP1, DEC1, FUSE, FINAL, CONFIDENCE];

/// Those of the U-Net, in order.
pub const UNET: &[Layer] = &[ENC1, ENC2, ENC3, UP2, DEC2, UP1, DEC1, FUSE, FINAL];

/// Length of the flat weight vector.
pub const WEIGHTS: usize = CONFIDENCE.end();

/// Columns of the tile of a workgroup of `residual_conv`, and rows of one of its row groups.
pub const CONV_TILE: [u32; 2] = [32, 8];
/// Outputs that a thread of `residual_conv` owns.
pub const CONV_OUTPUTS: u32 = 20;
/// Rows of the tile of a workgroup of `half_conv`.
pub const HALF_CONV_ROWS: u32 = 16;
/// Subgroups of a workgroup of the `half_head` kernels.
pub const HALF_SUBGROUPS: u32 = 4;

#[cfg(test)]
mod tests {
    #[test]
    fn as_many_parameters_as_published() {
        let inputs = super::HIDDEN * (super::FEATURES - super::WIDTHS[0]);
        let gate = super::FINAL.inputs + 1;
        assert_eq!(super::FINAL.end() - inputs - gate, 66_095);
    }
}
