//! Stable radix sort of u32 keys with u32 values, 8 bits a pass.

use super::{Buffer, Gpu, GpuError, Pass};
use bytemuck::bytes_of;
use ibgs_shaders::types::SortParams;
use ibgs_shaders::{SORT_BINS, SORT_BLOCK, SORT_COUNT, SORT_ROWS, SORT_SCATTER};

/// Two pairs of key and value buffers, and scratch, for at most `capacity` keys.
#[derive(Debug)]
pub struct Sort {
    /// Keys; the first holds the input.
    pub keys: [Buffer; 2],
    /// Values, in step with the keys.
    pub values: [Buffer; 2],
    /// A row of blocks for each digit, and one more row with the digits' totals.
    histogram: Buffer,
    capacity: usize,
}

impl Sort {
    /// Buffers for up to `capacity` keys.
    ///
    /// # Errors
    /// When the device has not enough memory.
    pub fn new(gpu: &Gpu, capacity: usize) -> Result<Self, GpuError> {
        let capacity = capacity.max(1);
        let keys = || gpu.allocate("sort keys", 4 * capacity as u64);
        let bins = (capacity.div_ceil(SORT_BLOCK as usize) + 1) * SORT_BINS as usize;
        Ok(Self {
            keys: [keys()?, keys()?],
            values: [keys()?, keys()?],
            histogram: gpu.allocate("sort histogram", 4 * bins as u64)?,
            capacity,
        })
    }

    /// Keys the buffers hold.
    pub fn capacity(&self) -> usize {
        self.capacity
    }

    /// Records a stable sort of the first `min(count[0], capacity)` keys by their low `bits`; the values become the
    /// keys' former positions. Returns which of the two buffer pairs holds the result.
    pub fn record(&self, pass: &mut Pass, count: &Buffer, bits: u32) -> usize {
        let blocks = self.capacity.div_ceil(SORT_BLOCK as usize);
        let passes = bits.div_ceil(8).max(1);
        for p in 0..passes {
            let (from, to) = ((p % 2) as usize, ((p + 1) % 2) as usize);
            let params = SortParams {
                shift: 8 * p,
                blocks: blocks as u32,
                capacity: self.capacity as u32,
                first: u32::from(p == 0),
            };
            let immediates = bytes_of(&params);
            pass.groups(&SORT_COUNT, &[&self.keys[from], count, &self.histogram], immediates, blocks);
            pass.grid(&SORT_ROWS, &[count, &self.histogram], immediates, [SORT_BINS, 1, 1]);
            let buffers =
                [&self.keys[from], &self.values[from], count, &self.histogram, &self.keys[to], &self.values[to]];
            pass.groups(&SORT_SCATTER, &buffers, immediates, blocks);
        }
        (passes % 2) as usize
    }
}
