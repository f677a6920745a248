//! Loss statistics and intersection counts of the running training, read back some iterations late: by then the GPU is
//! long past them and nothing waits. The delay is a fixed number of iterations, so that a run repeats exactly.

use crate::loss::ImageStats;
use crate::readback::Readback;
use ibgs_core::gpu::{Buffer, Gpu, GpuError, Mark, Pass};
use serde::{Deserialize, Serialize};

/// Iterations between two readbacks.
const RING: usize = 32;
/// Iterations from asking for a readback to using it.
const DELAY: usize = 8;
/// Words of one entry: four statistics, the intersection count, values that are not finite, padding.
const ENTRY: usize = 8;
const RING_BYTES: u64 = (RING * ENTRY * size_of::<u32>()) as u64;

/// What the last finished readback said.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Telemetry {
    /// Mean statistics of the iterations read.
    pub stats: ImageStats,
    /// Most tile intersections of one iteration.
    pub most_isects: u64,
    /// True if a loss or a value of the model was not a finite number.
    pub broken: bool,
    /// Iterations that had more intersections than room.
    pub overflows: u32,
}

/// A readback in flight.
#[derive(Debug)]
struct Pending {
    words: Words,
    /// Room that each entry's iteration had.
    capacities: [u64; RING],
}

/// The ring as it was when it was full.
#[derive(Debug)]
enum Words {
    /// On their way.
    Coming(Readback),
    /// Read already, for a checkpoint.
    Here(Vec<u32>),
}

/// The words of a full ring, and the room that each entry's iteration had.
type Full = (Vec<u32>, [u64; RING]);

/// A recorder on the host.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RecorderState {
    written: usize,
    capacities: [u64; RING],
    ring: Vec<u32>,
    pending: Option<Full>,
}

impl RecorderState {
    /// Whether a recorder can resume from it.
    pub fn is_sound(&self, iteration: u32) -> bool {
        let words = RING * ENTRY;
        self.written <= iteration as usize
            && self.ring.len() == words
            && self.pending.as_ref().is_none_or(|(pending, _)| pending.len() == words)
    }
}

/// A ring of entries on the GPU and one readback in flight.
#[derive(Debug)]
pub(super) struct Recorder {
    ring: Buffer<u32>,
    /// Counts values that are not finite.
    broken: Buffer<u32>,
    staging: wgpu::Buffer,
    pending: Option<Pending>,
    written: usize,
    /// Room that each entry's iteration had.
    capacities: [u64; RING],
}

impl Recorder {
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Ok(Self {
            ring: gpu.allocate("training telemetry", RING * ENTRY)?,
            broken: gpu.allocate("training telemetry", 1)?,
            staging: gpu.staging(RING_BYTES),
            pending: None,
            written: 0,
            capacities: [0; RING],
        })
    }

    /// Whether this iteration counts the values of the model that are not finite: once in each ring.
    pub fn checks(&self) -> bool {
        self.written % RING == RING - 1
    }

    /// Where they are counted.
    pub fn broken(&self) -> &Buffer<u32> {
        &self.broken
    }

    /// Records one iteration at the end of its last pass, and submits that pass: where the iteration ends, and telemetry when a
    /// readback is due.
    pub fn submit(
        &mut self,
        gpu: &Gpu,
        mut pass: Pass,
        stats: &Buffer<f32>,
        isects: &Buffer<u32>,
        capacity: u64,
    ) -> Result<(Mark, Option<Telemetry>), GpuError> {
        let at = (self.written % RING) * ENTRY;
        // By their bits, among other words.
        pass.copy(&stats.cast(), &self.ring, at, 4);
        pass.copy(isects, &self.ring, at + 4, 1);
        pass.copy(&self.broken, &self.ring, at + 5, 1);
        self.capacities[self.written % RING] = capacity;
        self.written += 1;
        let full = self.written.is_multiple_of(RING);
        if full {
            pass.copy_out(&self.ring, &self.staging, 0, RING_BYTES);
        }
        let end = pass.submit_marked();
        if full {
            let words = Words::Coming(Readback::new(&self.staging, end.clone()));
            self.pending = Some(Pending { words, capacities: self.capacities });
        }
        let telemetry = if self.written % RING == DELAY { self.collect(gpu)? } else { None };
        Ok((end, telemetry))
    }

    fn collect(&mut self, gpu: &Gpu) -> Result<Option<Telemetry>, GpuError> {
        Ok(self.take(gpu)?.map(|(words, capacities)| summary(&words, &capacities)))
    }

    /// Takes what is pending; waits for it.
    fn take(&mut self, gpu: &Gpu) -> Result<Option<Full>, GpuError> {
        let Some(Pending { words, capacities }) = self.pending.take() else { return Ok(None) };
        let words = match words {
            Words::Here(words) => words,
            Words::Coming(readback) => readback.words(gpu, &self.staging)?,
        };
        Ok(Some((words, capacities)))
    }

    /// Reads everything back; waits for the GPU.
    pub fn state(&mut self, gpu: &Gpu) -> Result<RecorderState, GpuError> {
        let pending = self.take(gpu)?;
        self.pending = pending.clone().map(|(words, capacities)| Pending { words: Words::Here(words), capacities });
        let ring = gpu.read(&self.ring, RING * ENTRY)?;
        Ok(RecorderState { written: self.written, capacities: self.capacities, ring, pending })
    }

    /// A recorder that resumes from there.
    pub fn from_state(gpu: &Gpu, state: &RecorderState) -> Result<Self, GpuError> {
        let pending = state.pending.clone();
        Ok(Self {
            ring: gpu.upload("training telemetry", &state.ring)?,
            pending: pending.map(|(words, capacities)| Pending { words: Words::Here(words), capacities }),
            written: state.written,
            capacities: state.capacities,
            ..Self::new(gpu)?
        })
    }
}

fn summary(words: &[u32], capacities: &[u64; RING]) -> Telemetry {
    let mut sums = [0.0f32; 4];
    let (mut most, mut overflows, mut broken) = (0, 0, false);
    for (entry, capacity) in words.chunks_exact(ENTRY).zip(capacities) {
        for (sum, &bits) in sums.iter_mut().zip(entry) {
            *sum += f32::from_bits(bits) / RING as f32;
        }
        most = most.max(u64::from(entry[4]));
        broken |= entry[5] != 0;
        overflows += u32::from(u64::from(entry[4]) > *capacity);
    }
    broken |= !sums[0].is_finite();
    Telemetry { stats: ImageStats::from_values(sums), most_isects: most, broken, overflows }
}
