// Where the weights of the per-view MLP and of the confidence in a source lie in the flat vector of src/layers.rs: W1 [32][FEATURES], b1,
// W2 [32][32], b2 at its front, the confidence (w [33], b), which reads the hidden channels and the error of the depth, at its end.
const HIDDEN: u32 = MLP_CHANNELS;
const FEATURES: u32 = MLP_FEATURES;
// Place of the one behind the numbers of a source: its weights are the biases.
const ONE: u32 = FEATURES;
const BIAS1: u32 = HIDDEN * FEATURES;
const WEIGHT2: u32 = BIAS1 + HIDDEN;
const BIAS2: u32 = WEIGHT2 + HIDDEN * HIDDEN;
const MLP_WEIGHTS: u32 = BIAS2 + HIDDEN;
const CONFIDENCE_WEIGHTS: u32 = HIDDEN + 2u;
