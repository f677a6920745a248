//! How fast the device moves memory and computes, measured.

use super::median;
use ibgs_core::gpu::{Gpu, GpuError, Pass, RawBuffer};
use ibgs_shaders::bindings::{BenchCopyBindings, BenchFmaBindings};
use ibgs_shaders::types::{CountParams, FmaParams};
use ibgs_shaders::{BENCH_FMAS, Bindings};
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// Bytes of the copied buffer: beyond the caches of large GPUs, and quick on a software adapter.
const COPIED: [u64; 2] = [512 << 20, 32 << 20];
/// Least duration of a run of multiply-adds, in milliseconds.
const LONG_ENOUGH: f64 = 2.0;
/// Fewest and most threads of multiply-adds.
const THREADS: [u32; 2] = [1 << 12, 1 << 22];
/// Steps of each of them.
const STEPS: u32 = 32;
/// Measured runs, after as many for warm-up.
const RUNS: usize = 5;

/// What the floors are computed from.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rates {
    /// Bytes read and written a second by a copy of a large buffer.
    pub bytes_per_second: f64,
    /// Floating-point operations a second of multiply-adds in registers, two each.
    pub operations_per_second: f64,
}

/// Milliseconds of one dispatch: by timestamps, or by the clock where the device has none.
fn time<'b, T: Bindings<'b, RawBuffer>>(
    gpu: &Gpu,
    buffers: &T,
    params: &T::Params,
    items: usize,
) -> Result<f64, GpuError> {
    let by_timestamps = gpu.start_profile();
    gpu.wait()?;
    let start = Instant::now();
    let mut pass = Pass::new(gpu, "rates");
    pass.linear(buffers, params, items);
    pass.submit();
    gpu.wait()?;
    let clock = 1e3 * start.elapsed().as_secs_f64();
    let measured: f64 = gpu.finish_profile().iter().map(|measured| measured.ms).sum();
    Ok(if by_timestamps && measured > 0.0 { measured } else { clock })
}

fn median_time(run: &mut dyn FnMut() -> Result<f64, GpuError>) -> Result<f64, GpuError> {
    for _ in 0..RUNS {
        run()?;
    }
    Ok(median((0..RUNS).map(|_| run()).collect::<Result<_, _>>()?))
}

impl Rates {
    /// Measures both; takes a fraction of a second.
    ///
    /// # Errors
    /// Not enough memory, or the device is lost.
    pub fn measure(gpu: &Gpu) -> Result<Self, GpuError> {
        Ok(Self { bytes_per_second: bandwidth(gpu)?, operations_per_second: operations(gpu)? })
    }
}

fn bandwidth(gpu: &Gpu) -> Result<f64, GpuError> {
    let count = (COPIED[usize::from(gpu.is_software())].min(gpu.binding_limit()) / 16) as u32;
    let [from, to] = [gpu.allocate("copy", count as usize)?, gpu.allocate("copy", count as usize)?];
    let buffers = BenchCopyBindings { values: &from, copied: &to };
    let ms = median_time(&mut || time(gpu, &buffers, &CountParams { count }, count as usize))?;
    Ok(2.0 * 16.0 * f64::from(count) / (1e-3 * ms))
}

fn operations(gpu: &Gpu) -> Result<f64, GpuError> {
    let values = gpu.upload("multiply-adds", &[0.999f32, 0.5])?;
    let sums = gpu.allocate("multiply-adds", THREADS[1] as usize)?;
    let run = |count: u32| {
        let params = FmaParams { count, steps: STEPS };
        time(gpu, &BenchFmaBindings { factor_and_summand: &values, sums: &sums }, &params, count as usize)
    };
    let mut count = THREADS[0];
    run(count)?;
    while count < THREADS[1] && run(count)? < LONG_ENOUGH {
        count *= 2;
    }
    let ms = median_time(&mut || run(count))?;
    Ok(2.0 * f64::from(count) * f64::from(STEPS * BENCH_FMAS) / (1e-3 * ms))
}
