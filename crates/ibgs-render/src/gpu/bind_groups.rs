//! Bind groups, which dispatches with the same buffers share: in a training most dispatches of an iteration bind what those of
//! the last one did, and making a bind group costs the host as much as recording its dispatch.

use super::RawBuffer;
use super::pipeline::Pipeline;
use ibgs_shaders::Kernel;
use std::collections::HashMap;
use std::collections::hash_map::{Entry, RandomState};
use std::hash::{BuildHasher, Hash, Hasher};
use std::num::NonZeroU64;
use std::sync::Mutex;

/// Most bind groups that are kept.
const MOST: usize = 2048;

/// A kernel's bind group and what it binds: wgpu buffer, first byte, bytes.
#[derive(Debug)]
struct Bound {
    kernel: &'static str,
    buffers: Vec<(wgpu::Buffer, u64, u64)>,
    group: wgpu::BindGroup,
}

impl Bound {
    fn is(&self, kernel: &Kernel, buffers: &[&RawBuffer]) -> bool {
        let same = |((buffer, offset, size), b): (&(wgpu::Buffer, u64, u64), &&RawBuffer)| {
            *buffer == b.buffer && *offset == b.offset && *size == b.size
        };
        self.kernel == kernel.name && self.buffers.len() == buffers.len() && self.buffers.iter().zip(buffers).all(same)
    }
}

/// Bind groups of a device by a hash of what they bind. They keep their buffers' memory, so all of them go when new memory is
/// allocated or unused memory is released.
#[derive(Debug, Default)]
pub(super) struct BindGroups {
    kept: Mutex<HashMap<u64, Bound>>,
    hashes: RandomState,
}

impl BindGroups {
    /// The kernel's bind group with these buffers.
    pub fn get(
        &self,
        device: &wgpu::Device,
        pipeline: &Pipeline,
        kernel: &'static Kernel,
        buffers: &[&RawBuffer],
    ) -> wgpu::BindGroup {
        let mut hasher = self.hashes.build_hasher();
        kernel.name.hash(&mut hasher);
        buffers.iter().for_each(|b| (&b.buffer, b.offset, b.size).hash(&mut hasher));
        let mut kept = self.kept.lock().expect("bind groups");
        if kept.len() == MOST {
            kept.clear();
        }
        match kept.entry(hasher.finish()) {
            Entry::Occupied(entry) if entry.get().is(kernel, buffers) => entry.get().group.clone(),
            entry => {
                let group = make(device, pipeline, kernel, buffers);
                let buffers = buffers.iter().map(|b| (b.buffer.clone(), b.offset, b.size)).collect();
                entry.insert_entry(Bound { kernel: kernel.name, buffers, group: group.clone() });
                group
            }
        }
    }

    /// Lets go of all of them.
    pub fn clear(&self) {
        self.kept.lock().expect("bind groups").clear();
    }
}

fn make(device: &wgpu::Device, pipeline: &Pipeline, kernel: &Kernel, buffers: &[&RawBuffer]) -> wgpu::BindGroup {
    let entries: Vec<_> = (0u32..)
        .zip(buffers)
        .map(|(binding, b)| wgpu::BindGroupEntry {
            binding,
            resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                buffer: &b.buffer,
                offset: b.offset,
                size: NonZeroU64::new(b.size),
            }),
        })
        .collect();
    let descriptor =
        wgpu::BindGroupDescriptor { label: Some(kernel.name), layout: &pipeline.layout, entries: &entries };
    device.create_bind_group(&descriptor)
}
