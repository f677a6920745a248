//! The opacity reset.

use ibgs_core::gpu::Pass;
use ibgs_reference::gpu::gpu;
use ibgs_shaders::bindings::OpacityResetBindings;
use ibgs_shaders::types::OpacityResetParams;

#[test]
fn opacity_reset_clamps_from_above_and_clears_moments() {
    let gpu = gpu();
    let logits = gpu.upload("logits", &[-9.0f32, -4.0, 3.0]).unwrap();
    let m = gpu.upload("m", &[1.0f32; 3]).unwrap();
    let v = gpu.upload("v", &[1.0f32; 3]).unwrap();
    let params = OpacityResetParams { count: 3, limit: -4.5 };
    let mut pass = Pass::new(&gpu, "test");
    pass.linear(&OpacityResetBindings { opacity_logits: &logits, moment1: &m, moment2: &v }, &params, 3);
    pass.submit();
    assert_eq!(gpu.read::<f32>(&logits, 3).unwrap(), [-9.0, -4.5, -4.5]);
    for moment in [m, v] {
        assert_eq!(gpu.read::<f32>(&moment, 3).unwrap(), [0.0; 3]);
    }
}
