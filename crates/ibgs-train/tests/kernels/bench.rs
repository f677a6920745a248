//! The kernels that measure the device, against what they must compute.

use ibgs_core::gpu::Pass;
use ibgs_reference::gpu::gpu;
use ibgs_shaders::BENCH_FMAS;
use ibgs_shaders::bindings::{BenchCopyBindings, BenchFmaBindings};
use ibgs_shaders::types::{CountParams, FmaParams};
use ibgs_train::bench::Rates;

#[test]
fn the_copy_is_a_copy() {
    let gpu = gpu();
    // Not a multiple of the workgroup; one more vec4 must stay as it was.
    let count = 1003u32;
    let values: Vec<[f32; 4]> = (0..=count).map(|i| [1.0, 2.0, 3.0, 4.0].map(|v| v + 4.0 * i as f32)).collect();
    let (from, to) = (gpu.upload("from", &values).unwrap(), gpu.allocate("to", count as usize + 1).unwrap());
    let mut pass = Pass::new(&gpu, "test");
    pass.linear(&BenchCopyBindings { values: &from, copied: &to }, &CountParams { count }, count as usize);
    pass.submit();
    let copied = gpu.read(&to, values.len()).unwrap();
    let (inside, outside) = copied.split_at(count as usize);
    assert_eq!(inside, &values[..inside.len()]);
    assert_eq!(outside, [[0.0; 4]]);
}

/// In double precision.
fn twin(i: usize, x: f64, y: f64, steps: u32) -> f64 {
    let chain = |start: f64| (0..steps * BENCH_FMAS / 16).fold(start, |a, _| x * a + y);
    (0..16).map(|k| chain(i as f64 + f64::from(k / 4) + 0.25 * f64::from(k % 4))).sum()
}

#[test]
fn every_multiply_add_is_done() {
    let gpu = gpu();
    let (count, steps) = (301u32, 3);
    let (x, y) = (0.97f32, 0.5f32);
    let values = gpu.upload("values", &[x, y]).unwrap();
    let sums = gpu.allocate("sums", count as usize + 3).unwrap();
    let mut pass = Pass::new(&gpu, "test");
    let params = FmaParams { count, steps };
    pass.linear(&BenchFmaBindings { factor_and_summand: &values, sums: &sums }, &params, count as usize);
    pass.submit();
    let ours = gpu.read(&sums, count as usize + 3).unwrap();
    let mut largest = 0.0f64;
    for (i, sum) in ours[..count as usize].iter().enumerate() {
        let expected = twin(i, x.into(), y.into(), steps);
        largest = largest.max((f64::from(*sum) - expected).abs() / expected);
    }
    println!("largest relative error {largest:.1e}");
    assert!(largest < 1e-5, "{largest}");
    assert_eq!(ours[count as usize..], [0.0; 3]);
    // A step less would be seen.
    let [fewer, all] = [steps - 1, steps].map(|steps| twin(300, x.into(), y.into(), steps));
    assert!((fewer - all).abs() > 1e-2 * all);
}

#[test]
fn rates_are_plausible() {
    let rates = Rates::measure(&gpu()).unwrap();
    println!("{rates:?}");
    assert!((1e8..1e14).contains(&rates.bytes_per_second), "{rates:?}");
    assert!((1e8..1e16).contains(&rates.operations_per_second), "{rates:?}");
}
