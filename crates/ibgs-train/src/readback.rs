//! A few words that the device hands to the host some iterations later.

use ibgs_core::gpu::{Gpu, GpuError, Mark};
use std::sync::mpsc::{Receiver, channel};

/// A readback in flight.
#[derive(Debug)]
pub(super) struct Readback {
    mapped: Receiver<Result<(), wgpu::BufferAsyncError>>,
    end: Mark,
}

impl Readback {
    /// Begins to read a staging buffer, whose last writes end there.
    pub fn new(staging: &wgpu::Buffer, end: Mark) -> Self {
        let (sender, mapped) = channel();
        staging.map_async(wgpu::MapMode::Read, .., move |result| {
            let _ = sender.send(result);
        });
        Self { mapped, end }
    }

    /// The words of the buffer; waits for them.
    pub fn words<T: bytemuck::Pod>(self, gpu: &Gpu, staging: &wgpu::Buffer) -> Result<Vec<T>, GpuError> {
        let failed = |e: String| GpuError::Readback(e);
        gpu.wait_for(self.end)?;
        gpu.answer(&self.mapped)?.map_err(|e| failed(e.to_string()))?;
        let range = staging.get_mapped_range(..).map_err(|e| failed(e.to_string()))?;
        let words = bytemuck::pod_collect_to_vec(&range[..]);
        drop(range);
        staging.unmap();
        Ok(words)
    }
}
