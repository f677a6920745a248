//! Immediate data of kernels on a device that has none, as in browsers: a uniform whose offset moves from dispatch to dispatch.

use super::adapter::IMMEDIATES;
use std::num::NonZeroU64;
use std::sync::Mutex;

/// Bytes from dispatch to dispatch: the largest alignment of an offset that an adapter may ask for.
const STRIDE: usize = 256;
/// Dispatches of a chunk.
const DISPATCHES: usize = 128;

/// The chunks of a device, which passes take and give back.
#[derive(Debug)]
pub(super) struct Uniforms {
    layout: wgpu::BindGroupLayout,
    free: Mutex<Vec<Chunk>>,
}

/// Immediate data of up to [`DISPATCHES`] dispatches.
#[derive(Debug)]
pub(super) struct Chunk {
    buffer: wgpu::Buffer,
    group: wgpu::BindGroup,
    /// What the buffer is to hold once the pass is submitted.
    bytes: Vec<u8>,
}

impl Uniforms {
    pub(super) fn new(device: &wgpu::Device) -> Self {
        let entry = wgpu::BindGroupLayoutEntry {
            binding: 0,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Uniform,
                has_dynamic_offset: true,
                min_binding_size: None,
            },
            count: None,
        };
        let descriptor = wgpu::BindGroupLayoutDescriptor { label: Some("immediate data"), entries: &[entry] };
        Self { layout: device.create_bind_group_layout(&descriptor), free: Mutex::default() }
    }

    /// Layout of the group with the uniform.
    pub(super) fn layout(&self) -> &wgpu::BindGroupLayout {
        &self.layout
    }

    /// Adds the data of a dispatch to the chunks of its pass; the group to bind, and its offset.
    pub(super) fn put<'a>(
        &self,
        device: &wgpu::Device,
        chunks: &'a mut Vec<Chunk>,
        data: &[u8],
    ) -> (&'a wgpu::BindGroup, u32) {
        if chunks.last().is_none_or(|chunk| chunk.bytes.len() == DISPATCHES * STRIDE) {
            let free = self.free.lock().expect("free uniforms").pop();
            chunks.push(free.unwrap_or_else(|| self.chunk(device)));
        }
        let chunk = chunks.last_mut().expect("one has room");
        let offset = chunk.bytes.len();
        chunk.bytes.extend_from_slice(data);
        chunk.bytes.resize(offset + STRIDE, 0);
        (&chunk.group, offset as u32)
    }

    fn chunk(&self, device: &wgpu::Device) -> Chunk {
        let buffer = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("immediate data"),
            size: (DISPATCHES * STRIDE) as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let size = NonZeroU64::new(IMMEDIATES.into());
        let resource = wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer: &buffer, offset: 0, size });
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("immediate data"),
            layout: &self.layout,
            entries: &[wgpu::BindGroupEntry { binding: 0, resource }],
        });
        Chunk { buffer, group, bytes: Vec::new() }
    }

    /// Submits passes whose dispatches read the chunks. Others may take them afterwards: the queue keeps the order, so what they
    /// write does not reach these.
    pub(super) fn submit(
        &self,
        queue: &wgpu::Queue,
        commands: Vec<wgpu::CommandBuffer>,
        mut chunks: Vec<Chunk>,
    ) -> wgpu::SubmissionIndex {
        for chunk in &chunks {
            queue.write_buffer(&chunk.buffer, 0, &chunk.bytes);
        }
        let index = queue.submit(commands);
        chunks.iter_mut().for_each(|chunk| chunk.bytes.clear());
        self.free.lock().expect("free uniforms").append(&mut chunks);
        index
    }
}
