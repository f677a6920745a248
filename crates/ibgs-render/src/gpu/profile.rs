//! GPU time by pass and kernel, from timestamps around every dispatch. Off unless asked for: it waits after every submit.

use super::{Buffer, Gpu, GpuError};
use ibgs_shaders::Kernel;
use std::collections::BTreeMap;

const QUERIES: u32 = 1024;

/// The label of a pass, and a kernel within it.
pub type Launch = (&'static str, &'static Kernel);

/// What a kernel took within the passes of one label.
#[derive(Clone, Copy, Debug)]
pub struct Measured {
    /// Label of the pass.
    pub pass: &'static str,
    /// The kernel.
    pub kernel: &'static Kernel,
    /// Milliseconds in all.
    pub ms: f64,
    /// Dispatches.
    pub dispatches: u64,
}

/// Collects timestamps.
pub(super) struct Profiler {
    pub set: wgpu::QuerySet,
    resolve: wgpu::Buffer,
    /// What each pair of timestamps recorded since the last submit belongs to.
    pub pending: Vec<Launch>,
    /// By the label of the pass and the kernel's name.
    totals: BTreeMap<(&'static str, &'static str), Measured>,
}

impl Profiler {
    /// Index of the next pair of queries, or none when the set is full.
    pub fn begin(&mut self, launch: Launch) -> Option<u32> {
        let index = 2 * self.pending.len() as u32;
        (index + 2 <= QUERIES).then(|| {
            self.pending.push(launch);
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

    /// What was measured since the start or the last call; measuring continues.
    pub fn take_profile(&self) -> Vec<Measured> {
        let mut profiler = self.profiler.lock().expect("profiler");
        let totals = profiler.as_mut().map(|p| std::mem::take(&mut p.totals)).unwrap_or_default();
        totals.into_values().collect()
    }

    /// Stops measuring; what [`Gpu::take_profile`] would give.
    pub fn finish_profile(&self) -> Vec<Measured> {
        let measured = self.take_profile();
        *self.profiler.lock().expect("profiler") = None;
        measured
    }

    /// Reads the timestamps of the last submit.
    pub(super) fn collect_profile(&self) -> Result<(), GpuError> {
        let mut profiler = self.profiler.lock().expect("profiler");
        let Some(profiler) = profiler.as_mut().filter(|p| !p.pending.is_empty()) else {
            return Ok(());
        };
        let pending = std::mem::take(&mut profiler.pending);
        let view = Buffer::<u64>::whole(profiler.resolve.clone()).part(0, 2 * pending.len());
        let ticks = self.read(&view, 2 * pending.len())?;
        let period = f64::from(self.queue.get_timestamp_period());
        for (&(pass, kernel), pair) in pending.iter().zip(ticks.chunks_exact(2)) {
            let none = Measured { pass, kernel, ms: 0.0, dispatches: 0 };
            let total = profiler.totals.entry((pass, kernel.name)).or_insert(none);
            total.ms += pair[1].saturating_sub(pair[0]) as f64 * period * 1e-6;
            total.dispatches += 1;
        }
        Ok(())
    }
}
