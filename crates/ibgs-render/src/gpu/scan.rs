//! Exclusive prefix sum of u32 values.

use super::{Buffer, Gpu, GpuError, Pass};
use ibgs_shaders::SCAN_BLOCK;
use ibgs_shaders::bindings::{ScanApplyBindings, ScanReduceBindings};
use ibgs_shaders::types::CountParams;

/// Scratch memory of a scan of at most `capacity` values.
#[derive(Debug)]
pub struct Scan {
    block_sums: Buffer<u32>,
    capacity: usize,
}

impl Scan {
    /// Scratch for up to `capacity` values.
    ///
    /// # Errors
    /// When the device has not enough memory.
    pub fn new(gpu: &Gpu, capacity: usize) -> Result<Self, GpuError> {
        let blocks = capacity.div_ceil(SCAN_BLOCK as usize).max(1);
        Ok(Self { block_sums: gpu.allocate("prefix sums", blocks)?, capacity })
    }

    /// Records `sums = exclusive prefix sum of values[..count]` and `total[0] = their sum` (modulo 2^32).
    pub fn record(&self, pass: &mut Pass, values: &Buffer<u32>, sums: &Buffer<u32>, total: &Buffer<u32>, count: usize) {
        assert!(count <= self.capacity, "scan scratch too small");
        let params = CountParams { count: count as u32 };
        let block_sums = &self.block_sums;
        let blocks = count.div_ceil(SCAN_BLOCK as usize);
        pass.groups(&ScanReduceBindings { values, block_sums }, &params, blocks);
        // Without values there still is a sum.
        pass.groups(&ScanApplyBindings { values, block_sums, sums, total }, &params, blocks.max(1));
    }
}
