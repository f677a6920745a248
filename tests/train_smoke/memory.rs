//! The estimate of a training's memory against what it takes.

use crate::common::open_gpu;
use ibgs_core::bench::{Rates, Setting, measure, synthetic};
use ibgs_core::memory::Bytes;
use ibgs_core::train::config::TrainConfig;

/// On a device of its own: the others of the process hold the memory of other tests.
#[test]
fn the_estimate_is_what_the_allocator_reports() {
    let gpu = open_gpu();
    let (gaussians, camera) = synthetic(20_000, 2, 160, 120);
    let config = TrainConfig::default();
    let setting = Setting { gaussians: &gaussians, camera, config: &config };
    let rates = Rates { bytes_per_second: 1e9, operations_per_second: 1e9 };
    let measured = measure(&gpu, &rates, "test", &setting, 1).unwrap();
    let memory = measured.memory.expect("the driver of the tests tells");
    for kind in &memory.kinds {
        println!("{:>12} in {:>4} {}", kind.bytes, kind.buffers, kind.name);
    }
    println!("{} allocated, {} estimated", Bytes(memory.allocated_bytes), Bytes(measured.estimated_bytes));
    let ratio = measured.estimated_bytes as f64 / memory.allocated_bytes as f64;
    assert!((0.75..=1.25).contains(&ratio), "{ratio:.2} of what is allocated");
}
