//! The opacity reset.

use ibgs_core::gpu::Pass;
use ibgs_reference::gpu::gpu;
use ibgs_shaders::bindings::OpacityResetBindings;
use ibgs_shaders::types::OpacityResetParams;

#[test]
fn opacity_reset_clamps_from_above() {
    let gpu = gpu();
    let logits = gpu.upload("logits", &[-9.0f32, -4.0, 3.0]).unwrap();
    let mut pass = Pass::new(&gpu, "test");
    pass.linear(&OpacityResetBindings { opacity_logits: &logits }, &OpacityResetParams { count: 3, limit: -4.5 }, 3);
    pass.submit();
    assert_eq!(gpu.read::<f32>(&logits, 3).unwrap(), [-9.0, -4.5, -4.5]);
}
