//! Loss statistics and intersection counts of the running training, read back some iterations late: by then the GPU is
//! long past them and nothing waits. The delay is a fixed number of iterations, so that a run repeats exactly.

use crate::gpu::{Buffer, Gpu, GpuError, Mark, Pass};
use crate::loss::ImageStats;
use std::sync::mpsc::{Receiver, channel};

/// Iterations between two readbacks.
const RING: usize = 32;
/// Iterations from asking for a readback to using it.
const DELAY: usize = 8;
/// Bytes of one entry: four statistics, the intersection count, padding.
const ENTRY: usize = 32;

/// What the last finished readback said.
#[derive(Clone, Copy, Debug, Default)]
pub struct Telemetry {
    /// Mean statistics of the iterations read.
    pub stats: ImageStats,
    /// Most tile intersections of one iteration.
    pub most_isects: u64,
    /// True if a loss was not a finite number.
    pub broken: bool,
    /// Iterations that had more intersections than room.
    pub overflows: u32,
}

/// A readback in flight.
#[derive(Debug)]
struct Pending {
    mapped: Receiver<Result<(), wgpu::BufferAsyncError>>,
    mark: Mark,
    /// Room that each entry's iteration had.
    capacities: [u64; RING],
}

/// A ring of entries on the GPU and one readback in flight.
#[derive(Debug)]
pub(super) struct Recorder {
    ring: Buffer,
    staging: wgpu::Buffer,
    pending: Option<Pending>,
    written: usize,
    /// Room that each entry's iteration had.
    capacities: [u64; RING],
}

impl Recorder {
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Ok(Self {
            ring: gpu.allocate("training telemetry", (RING * ENTRY) as u64)?,
            staging: gpu.staging((RING * ENTRY) as u64),
            pending: None,
            written: 0,
            capacities: [0; RING],
        })
    }

    /// Records one iteration; returns news when a readback is due.
    pub fn record(
        &mut self,
        gpu: &Gpu,
        stats: &Buffer,
        isects: &Buffer,
        capacity: u64,
    ) -> Result<Option<Telemetry>, GpuError> {
        let mut pass = Pass::new(gpu, "telemetry");
        let at = ((self.written % RING) * ENTRY) as u64;
        pass.copy(stats, &self.ring, at, 16);
        pass.copy(isects, &self.ring, at + 16, 4);
        self.capacities[self.written % RING] = capacity;
        self.written += 1;
        let full = self.written.is_multiple_of(RING);
        if full {
            pass.copy_out(&self.ring, &self.staging, 0, (RING * ENTRY) as u64);
        }
        pass.submit();
        if full {
            let (sender, mapped) = channel();
            self.staging.map_async(wgpu::MapMode::Read, .., move |result| {
                let _ = sender.send(result);
            });
            self.pending = Some(Pending { mapped, mark: gpu.mark(), capacities: self.capacities });
        }
        if self.written % RING == DELAY { self.collect(gpu) } else { Ok(None) }
    }

    fn collect(&mut self, gpu: &Gpu) -> Result<Option<Telemetry>, GpuError> {
        let Some(pending) = self.pending.take() else { return Ok(None) };
        let failed = |e: String| GpuError::Readback(e);
        gpu.wait_for(pending.mark)?;
        gpu.answer(&pending.mapped)?.map_err(|e| failed(e.to_string()))?;
        let mapped = self.staging.get_mapped_range(..).map_err(|e| failed(e.to_string()))?;
        let words: Vec<u32> = bytemuck::pod_collect_to_vec(&mapped[..]);
        drop(mapped);
        self.staging.unmap();
        Ok(Some(summary(&words, &pending.capacities)))
    }
}

fn summary(words: &[u32], capacities: &[u64; RING]) -> Telemetry {
    let mut sums = [0.0f32; 4];
    let (mut most, mut overflows) = (0, 0);
    for (entry, capacity) in words.chunks_exact(ENTRY / 4).zip(capacities) {
        for (sum, &bits) in sums.iter_mut().zip(entry) {
            *sum += f32::from_bits(bits) / RING as f32;
        }
        most = most.max(u64::from(entry[4]));
        overflows += u32::from(u64::from(entry[4]) > *capacity);
    }
    Telemetry { stats: ImageStats::from_values(sums), most_isects: most, broken: !sums[0].is_finite(), overflows }
}
