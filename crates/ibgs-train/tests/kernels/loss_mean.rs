//! The weighted mean of partial sums.

use ibgs_core::gpu::Pass;
use ibgs_reference::gpu::gpu;
use ibgs_shaders::bindings::LossMeanBindings;
use ibgs_shaders::types::MeanParams;

/// The loss, and the loss with the count beside it, of sums with their counts.
fn mean(partials: &[[f32; 2]], weight: f32) -> (f32, [f32; 2]) {
    let gpu = gpu();
    // What lies behind them is not read.
    let padded: Vec<[f32; 2]> = partials.iter().copied().chain([[1e9; 2]]).collect();
    let sums = gpu.upload("partials", &padded).unwrap();
    let loss = gpu.upload("loss", &[f32::NAN]).unwrap();
    let stats = gpu.upload("stats", &[f32::NAN; 2]).unwrap();
    let params = MeanParams { count: partials.len() as u32, weight };
    let mut pass = Pass::new(&gpu, "test");
    pass.groups(&LossMeanBindings { partials: &sums, loss: &loss, stats: &stats }, &params, 1);
    pass.submit();
    let stats = gpu.read(&stats, 2).unwrap();
    (gpu.read(&loss, 1).unwrap()[0], [stats[0], stats[1]])
}

#[test]
fn every_number_of_sums() {
    for n in [1, 2, 255, 256, 257, 3000] {
        let partials: Vec<[f32; 2]> = (0..n).map(|i| [0.25 * (i % 7) as f32 + 0.5, (i % 3) as f32 + 1.0]).collect();
        let [sum, count] = [0, 1].map(|c| partials.iter().map(|p| f64::from(p[c])).sum::<f64>());
        let (loss, [again, counted]) = mean(&partials, 0.3);
        let truth = f64::from(0.3f32) * sum / count;
        assert!((f64::from(loss) / truth - 1.0).abs() < 1e-6, "{n}: {loss} against {truth}");
        assert_eq!((again, f64::from(counted)), (loss, count), "{n}");
    }
}

#[test]
fn nothing_that_counts_costs_nothing() {
    assert_eq!(mean(&[[0.0; 2]; 5], 0.3), (0.0, [0.0; 2]));
    assert_eq!(mean(&[], 0.3), (0.0, [0.0; 2]));
}
