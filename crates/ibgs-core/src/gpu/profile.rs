//! GPU time by kernel, from timestamps around every dispatch. Off unless asked for: it waits after every submit.

use super::{Gpu, GpuError};
use std::collections::BTreeMap;

const QUERIES: u32 = 512;

/// Collects timestamps.
pub(super) struct Profiler {
    pub set: wgpu::QuerySet,
    resolve: wgpu::Buffer,
    /// Kernel of each pair of timestamps recorded since the last submit.
    pub pending: Vec<&'static str>,
    /// Nanoseconds by kernel, and how often it ran.
    totals: BTreeMap<&'static str, (f64, u64)>,
}

impl Profiler {
    /// Index of the next pair of queries, or none when the set is full.
    pub fn begin(&mut self, kernel: &'static str) -> Option<u32> {
        let index = 2 * self.pending.len() as u32;
        (index + 2 <= QUERIES).then(|| {
            self.pending.push(kernel);
            index
        })
    }

    pub fn resolve(&self, encoder: &mut wgpu::CommandEncoder) {
        if !self.pending.is_empty() {
            encoder.resolve_query_set(&self.set, 0..2 * self.pending.len() as u32, &self.resolve, 0);
        }
    }
}

impl Gpu {
    /// Starts (or restarts) measuring. False where the device has no timestamps.
    pub fn start_profile(&self) -> bool {
        if !self.device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
            return false;
        }
        let set = self.device.create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("profile"),
            ty: wgpu::QueryType::Timestamp,
            count: QUERIES,
        });
        let resolve = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("profile"),
            size: u64::from(QUERIES) * 8,
            usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        let profiler = Profiler { set, resolve, pending: Vec::new(), totals: BTreeMap::new() };
        *self.profiler.lock().expect("profiler") = Some(profiler);
        true
    }

    /// Stops measuring: (kernel, milliseconds in all, dispatches).
    pub fn finish_profile(&self) -> Vec<(&'static str, f64, u64)> {
        let profiler = self.profiler.lock().expect("profiler").take();
        let totals = profiler.map(|p| p.totals).unwrap_or_default();
        totals.into_iter().map(|(kernel, (ns, count))| (kernel, ns * 1e-6, count)).collect()
    }

    /// Reads the timestamps of the last submit.
    pub(super) fn collect_profile(&self) -> Result<(), GpuError> {
        let mut slot = self.profiler.lock().expect("profiler");
        let Some(profiler) = slot.as_mut().filter(|p| !p.pending.is_empty()) else {
            return Ok(());
        };
        let pending = std::mem::take(&mut profiler.pending);
        let size = pending.len() as u64 * 16;
        let view = super::Buffer { buffer: profiler.resolve.clone(), offset: 0, size };
        let ticks: Vec<u64> = self.read(&view, 2 * pending.len())?;
        let period = f64::from(self.queue.get_timestamp_period());
        for (kernel, pair) in pending.iter().zip(ticks.chunks_exact(2)) {
            let entry = profiler.totals.entry(kernel).or_default();
            entry.0 += pair[1].saturating_sub(pair[0]) as f64 * period;
            entry.1 += 1;
        }
        Ok(())
    }
}
