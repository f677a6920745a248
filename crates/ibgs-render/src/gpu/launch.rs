//! The only place that dispatches: a [`Pass`] records kernels and submits them, or leaves them to its [`Batch`].

use super::uniforms::Chunk;
use super::{Buffer, Gpu, Mark, RawBuffer};
use bytemuck::bytes_of;
use ibgs_shaders::{Bindings, Kernel};
use std::any::Any;
use std::cell::RefCell;
use std::sync::Arc;

/// What passes have recorded and not yet submitted.
pub(super) struct Recording {
    /// Consecutive dispatches share this compute pass, because each compute pass costs the host its own command
    /// buffers. Declared before `encoder`, which cannot do anything else while a compute pass is open.
    open: Option<wgpu::ComputePass<'static>>,
    encoder: wgpu::CommandEncoder,
    kept: Vec<Box<dyn Any>>,
    /// Immediate data of its dispatches, on a device without; the last one has room.
    chunks: Vec<Chunk>,
}

thread_local! {
    /// The batch of this thread.
    static BATCH: RefCell<Option<(Arc<Gpu>, Vec<Recording>)>> = const { RefCell::new(None) };
}

/// As long as it lives, the passes of its thread on its device are submitted together, in the order in which they end. Each
/// submission costs the host as much as several dispatches. Another library on the device sees their results, and may use
/// memory again that they use, only after [`flush`]. Waits and readbacks flush by themselves, and so does the batch's end.
#[derive(Debug)]
pub struct Batch(());

impl Batch {
    /// Begins the batch of this thread.
    ///
    /// # Panics
    /// When the thread has one already: a bug of ours.
    pub fn new(gpu: &Arc<Gpu>) -> Self {
        let last = BATCH.replace(Some((gpu.clone(), Vec::new())));
        assert!(last.is_none(), "a thread has one batch at a time");
        Self(())
    }
}

impl Drop for Batch {
    fn drop(&mut self) {
        flush();
        BATCH.set(None);
    }
}

/// Submits what the passes of this thread have left to their batch.
pub fn flush() {
    let open = BATCH.with_borrow_mut(|batch| {
        batch.as_mut().filter(|(_, open)| !open.is_empty()).map(|(gpu, open)| (gpu.clone(), std::mem::take(open)))
    });
    if let Some((gpu, open)) = open {
        gpu.submit(open);
    }
}

/// The open recordings of this thread's batch, where it has one on this device.
fn with_batch<R>(gpu: &Gpu, use_it: impl FnOnce(&mut Vec<Recording>) -> R) -> Option<R> {
    BATCH.with_borrow_mut(|batch| {
        let (_, open) = batch.as_mut().filter(|(of, _)| std::ptr::eq(&**of, gpu))?;
        Some(use_it(open))
    })
}

/// A row of kernel dispatches.
pub struct Pass<'a> {
    gpu: &'a Gpu,
    label: &'static str,
    recording: Recording,
}

impl<'a> Pass<'a> {
    /// Its device.
    pub fn gpu(&self) -> &'a Gpu {
        self.gpu
    }

    /// An empty pass; measurements distinguish kernels by its label too.
    pub fn new(gpu: &'a Gpu, label: &'static str) -> Self {
        let begun = || Recording {
            open: None,
            encoder: gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some(label) }),
            kept: Vec::new(),
            chunks: Vec::new(),
        };
        let recording = with_batch(gpu, Vec::pop).flatten().unwrap_or_else(begun);
        Self { gpu, label, recording }
    }

    /// Sets the label of the following dispatches in measurements.
    pub fn relabel(&mut self, label: &'static str) {
        self.label = label;
    }

    /// Dispatches enough workgroups for `items` threads in a row.
    pub fn linear<'b, T: Bindings<'b, RawBuffer>>(&mut self, buffers: &T, params: &T::Params, items: usize) {
        self.groups(buffers, params, items.div_ceil(T::KERNEL.workgroup[0] as usize));
    }

    /// Dispatches `groups` workgroups in a row, folded into two dimensions where the device's limit asks for it.
    pub fn groups<'b, T: Bindings<'b, RawBuffer>>(&mut self, buffers: &T, params: &T::Params, groups: usize) {
        let limit = self.gpu.limits.max_compute_workgroups_per_dimension as usize;
        let rows = groups.div_ceil(limit).max(1);
        let columns = groups.div_ceil(rows);
        self.grid(buffers, params, [columns as u32, rows as u32, 1]);
    }

    /// Dispatches a grid of workgroups; nothing when it is empty.
    pub fn grid<'b, T: Bindings<'b, RawBuffer>>(&mut self, buffers: &T, params: &T::Params, grid: [u32; 3]) {
        self.grid_of(T::KERNEL, buffers, params, grid);
    }

    /// The same with another kernel that has the same buffers and parameters.
    pub fn grid_of<'b, T: Bindings<'b, RawBuffer>>(
        &mut self,
        kernel: &'static Kernel,
        buffers: &T,
        params: &T::Params,
        grid: [u32; 3],
    ) {
        self.launch(kernel, buffers.in_order().as_ref(), bytes_of(params), grid);
    }

    fn launch(&mut self, kernel: &'static Kernel, buffers: &[&RawBuffer], immediates: &[u8], grid: [u32; 3]) {
        if grid.contains(&0) {
            return;
        }
        let pipeline = self.gpu.pipeline(kernel);
        let group = self.gpu.bind_groups.get(&self.gpu.device, &pipeline, kernel, buffers);
        let mut profiler = self.gpu.profiler.lock().expect("profiler");
        if profiler.is_some() {
            self.recording.open = None;
        }
        let query = profiler.as_mut().and_then(|p| p.begin((self.label, kernel)));
        let timestamp_writes = match (&*profiler, query) {
            (Some(p), Some(index)) => Some(wgpu::ComputePassTimestampWrites {
                query_set: &p.set,
                beginning_of_pass_write_index: Some(index),
                end_of_pass_write_index: Some(index + 1),
            }),
            _ => None,
        };
        let pass = self.recording.open.get_or_insert_with(|| {
            let descriptor = wgpu::ComputePassDescriptor { label: Some(self.label), timestamp_writes };
            self.recording.encoder.begin_compute_pass(&descriptor).forget_lifetime()
        });
        pass.set_pipeline(&pipeline.pipeline);
        pass.set_bind_group(0, &group, &[]);
        match &self.gpu.uniforms {
            _ if immediates.is_empty() => {}
            None => pass.set_immediates(0, immediates),
            Some(uniforms) => {
                let (group, offset) = uniforms.put(&self.gpu.device, &mut self.recording.chunks, immediates);
                pass.set_bind_group(1, group, &[offset]);
            }
        }
        pass.dispatch_workgroups(grid[0], grid[1], grid[2]);
    }

    /// Keeps a value alive until the pass is submitted, such as memory that the pass uses and nothing else may reuse
    /// before.
    pub fn keep(&mut self, owner: impl Any) {
        self.recording.kept.push(Box::new(owner));
    }

    /// Sets a buffer to zero.
    pub fn clear<T>(&mut self, buffer: &Buffer<T>) {
        self.recording.open = None;
        let RawBuffer { buffer, offset, size, .. } = buffer.raw();
        self.recording.encoder.clear_buffer(buffer, *offset, Some(*size));
    }

    /// Copies RGBA8 pixels, `stride` from row to row (a multiple of 64), into a texture.
    pub(crate) fn copy_to_texture(&mut self, pixels: &Buffer<u32>, stride: u32, texture: &wgpu::Texture) {
        self.recording.open = None;
        let RawBuffer { buffer, offset, .. } = pixels.raw();
        let layout =
            wgpu::TexelCopyBufferLayout { offset: *offset, bytes_per_row: Some(4 * stride), rows_per_image: None };
        let source = wgpu::TexelCopyBufferInfo { buffer, layout };
        self.recording.encoder.copy_buffer_to_texture(source, texture.as_image_copy(), texture.size());
    }

    /// Copies the first `count` rows to row `at` of another buffer.
    pub fn copy<T>(&mut self, source: &Buffer<T>, target: &Buffer<T>, at: usize, count: usize) {
        let row = size_of::<T>() as u64;
        let RawBuffer { buffer, offset, .. } = target.raw();
        self.copy_out(source, buffer, offset + at as u64 * row, count as u64 * row);
    }

    /// Copies the first `bytes` into a mappable buffer.
    pub fn copy_out<T>(&mut self, source: &Buffer<T>, target: &wgpu::Buffer, at: u64, bytes: u64) {
        self.recording.open = None;
        let RawBuffer { buffer, offset, .. } = source.raw();
        self.recording.encoder.copy_buffer_to_buffer(buffer, *offset, target, at, bytes);
    }

    /// Submits everything recorded, or leaves it to the [`Batch`].
    pub fn submit(self) {
        let mut recording = Some(self.recording);
        with_batch(self.gpu, |open| open.extend(recording.take()));
        if let Some(recording) = recording {
            self.gpu.submit(vec![recording]);
        }
    }

    /// Submits everything recorded, with the rest of the batch, and marks its end.
    pub fn submit_marked(self) -> Mark {
        let mut recordings = with_batch(self.gpu, std::mem::take).unwrap_or_default();
        recordings.push(self.recording);
        self.gpu.submit(recordings)
    }
}

impl Gpu {
    fn submit(&self, mut recordings: Vec<Recording>) -> Mark {
        recordings.iter_mut().for_each(|recording| recording.open = None);
        if let (Some(profiler), Some(last)) = (&*self.profiler.lock().expect("profiler"), recordings.last_mut()) {
            profiler.resolve(&mut last.encoder);
        }
        let mut chunks = Vec::new();
        let mut kept = Vec::new();
        let commands = recordings.into_iter().map(|mut recording| {
            chunks.append(&mut recording.chunks);
            kept.append(&mut recording.kept);
            recording.encoder.finish()
        });
        let commands: Vec<_> = commands.collect();
        let index = match &self.uniforms {
            None => self.queue.submit(commands),
            Some(uniforms) => uniforms.submit(&self.queue, commands, chunks),
        };
        drop(kept);
        if let Err(error) = self.collect_profile() {
            // Only measurements are lost.
            log::warn!("{error}");
        }
        Mark(index)
    }
}
