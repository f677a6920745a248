//! The only place that dispatches: a [`Pass`] records kernels into one encoder and submits it once.

use super::uniforms::Chunk;
use super::{Buffer, Gpu, Mark};
use ibgs_shaders::Kernel;
use std::any::Any;

/// One encoder of kernel dispatches.
pub struct Pass<'a> {
    gpu: &'a Gpu,
    label: &'static str,
    /// Consecutive dispatches share this compute pass, because each compute pass costs the host its own command
    /// buffers. Declared before `encoder`, which cannot do anything else while a compute pass is open.
    open: Option<wgpu::ComputePass<'static>>,
    encoder: wgpu::CommandEncoder,
    kept: Vec<Box<dyn Any>>,
    /// Immediate data of its dispatches, on a device without; the last one has room.
    chunks: Vec<Chunk>,
}

impl<'a> Pass<'a> {
    /// An empty pass; measurements distinguish kernels by its label too.
    pub fn new(gpu: &'a Gpu, label: &'static str) -> Self {
        let encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some(label) });
        Self { gpu, label, open: None, encoder, kept: Vec::new(), chunks: Vec::new() }
    }

    /// Sets the label of the following dispatches in measurements.
    pub fn relabel(&mut self, label: &'static str) {
        self.label = label;
    }

    /// Dispatches enough workgroups for `items` threads in a row.
    pub fn linear(&mut self, kernel: &'static Kernel, buffers: &[&Buffer], immediates: &[u8], items: usize) {
        let groups = items.div_ceil(kernel.workgroup[0] as usize);
        self.groups(kernel, buffers, immediates, groups);
    }

    /// Dispatches `groups` workgroups in a row, folded into two dimensions where the device's limit asks for it.
    pub fn groups(&mut self, kernel: &'static Kernel, buffers: &[&Buffer], immediates: &[u8], groups: usize) {
        let limit = self.gpu.limits.max_compute_workgroups_per_dimension as usize;
        let rows = groups.div_ceil(limit).max(1);
        let columns = groups.div_ceil(rows);
        self.grid(kernel, buffers, immediates, [columns as u32, rows as u32, 1]);
    }

    /// Dispatches a grid of workgroups; nothing when it is empty.
    ///
    /// # Panics
    /// When the buffers do not fit the kernel's table entry: a bug of ours.
    pub fn grid(&mut self, kernel: &'static Kernel, buffers: &[&Buffer], immediates: &[u8], grid: [u32; 3]) {
        assert_eq!(buffers.len(), kernel.bindings.len(), "{}: bindings", kernel.name);
        assert_eq!(immediates.len(), kernel.immediates as usize, "{}: immediates", kernel.name);
        if grid.contains(&0) {
            return;
        }
        let pipeline = self.gpu.pipeline(kernel);
        let entries: Vec<_> = (0u32..)
            .zip(buffers)
            .map(|(binding, b)| wgpu::BindGroupEntry {
                binding,
                resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                    buffer: &b.buffer,
                    offset: b.offset,
                    size: std::num::NonZeroU64::new(b.size),
                }),
            })
            .collect();
        let group = self.gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(kernel.name),
            layout: &pipeline.layout,
            entries: &entries,
        });
        let mut profiler = self.gpu.profiler.lock().expect("profiler");
        if profiler.is_some() {
            self.open = None;
        }
        let query = profiler.as_mut().and_then(|p| p.begin((self.label, kernel.name)));
        let timestamp_writes = match (&*profiler, query) {
            (Some(p), Some(index)) => Some(wgpu::ComputePassTimestampWrites {
                query_set: &p.set,
                beginning_of_pass_write_index: Some(index),
                end_of_pass_write_index: Some(index + 1),
            }),
            _ => None,
        };
        let pass = self.open.get_or_insert_with(|| {
            let descriptor = wgpu::ComputePassDescriptor { label: Some(self.label), timestamp_writes };
            self.encoder.begin_compute_pass(&descriptor).forget_lifetime()
        });
        pass.set_pipeline(&pipeline.pipeline);
        pass.set_bind_group(0, &group, &[]);
        match &self.gpu.uniforms {
            _ if immediates.is_empty() => {}
            None => pass.set_immediates(0, immediates),
            Some(uniforms) => {
                let (group, offset) = uniforms.put(&self.gpu.device, &mut self.chunks, immediates);
                pass.set_bind_group(1, group, &[offset]);
            }
        }
        pass.dispatch_workgroups(grid[0], grid[1], grid[2]);
    }

    /// Keeps a value alive until the pass is submitted, such as memory that the pass uses and nothing else may reuse
    /// before.
    pub fn keep(&mut self, owner: impl Any) {
        self.kept.push(Box::new(owner));
    }

    /// Sets a buffer to zero.
    pub fn clear(&mut self, buffer: &Buffer) {
        self.open = None;
        self.encoder.clear_buffer(&buffer.buffer, buffer.offset, Some(buffer.size));
    }

    /// Copies RGBA8 pixels, `stride` from row to row (a multiple of 64), into a texture.
    pub(crate) fn copy_to_texture(&mut self, pixels: &Buffer, stride: u32, texture: &wgpu::Texture) {
        self.open = None;
        let layout = wgpu::TexelCopyBufferLayout {
            offset: pixels.offset,
            bytes_per_row: Some(4 * stride),
            rows_per_image: None,
        };
        let source = wgpu::TexelCopyBufferInfo { buffer: &pixels.buffer, layout };
        self.encoder.copy_buffer_to_texture(source, texture.as_image_copy(), texture.size());
    }

    /// Copies the first `bytes` to byte `at` of another buffer.
    pub fn copy(&mut self, source: &Buffer, target: &Buffer, at: u64, bytes: u64) {
        self.copy_out(source, &target.buffer, target.offset + at, bytes);
    }

    /// Copies the first `bytes` into a mappable buffer.
    pub fn copy_out(&mut self, source: &Buffer, target: &wgpu::Buffer, at: u64, bytes: u64) {
        self.open = None;
        self.encoder.copy_buffer_to_buffer(&source.buffer, source.offset, target, at, bytes);
    }

    /// Submits everything recorded, and marks its end.
    pub fn submit(mut self) -> Mark {
        self.open = None;
        if let Some(profiler) = &*self.gpu.profiler.lock().expect("profiler") {
            profiler.resolve(&mut self.encoder);
        }
        let commands = self.encoder.finish();
        let index = match &self.gpu.uniforms {
            None => self.gpu.queue.submit([commands]),
            Some(uniforms) => uniforms.submit(&self.gpu.queue, commands, self.chunks),
        };
        if let Err(error) = self.gpu.collect_profile() {
            // Only measurements are lost.
            log::warn!("{error}");
        }
        Mark(index)
    }
}
