//! The search for values that are not finite.

use ibgs_core::gpu::Pass;
use ibgs_reference::gpu::gpu;
use ibgs_shaders::bindings::FiniteBindings;
use ibgs_shaders::types::CountParams;

#[test]
fn what_is_not_finite_is_counted() {
    let gpu = gpu();
    let mut values = vec![0.0f32, -0.0, f32::MAX, f32::MIN, f32::MIN_POSITIVE, 1e-45, -1.0];
    values.resize(1000, 0.5);
    let count = |values: &[f32]| {
        let (uploaded, broken) = (gpu.upload("values", values).unwrap(), gpu.upload("broken", &[0u32]).unwrap());
        let mut pass = Pass::new(&gpu, "test");
        // Beyond the count lie values that are not looked at.
        let looked_at = CountParams { count: values.len() as u32 - 1 };
        pass.linear(&FiniteBindings { values: &uploaded.cast(), broken: &broken }, &looked_at, values.len());
        pass.submit();
        gpu.read(&broken, 1).unwrap()[0]
    };
    assert_eq!(count(&values), 0);
    values[999] = f32::NAN;
    assert_eq!(count(&values), 0);
    for (i, bad) in
        [f32::NAN, -f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::from_bits(0x7f80_0001)].into_iter().enumerate()
    {
        values[7 * i + 300] = bad;
        assert_eq!(count(&values), i as u32 + 1);
    }
}
