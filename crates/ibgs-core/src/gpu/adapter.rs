//! Choosing an adapter.

use super::device::GpuError;
use super::matrix::{experimental_features, matrix_units};

/// What a device is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Use {
    /// Rendering models.
    Rendering,
    /// Training too.
    Training,
}

impl Use {
    /// Storage buffers that the widest kernel binds.
    fn storage_buffers(self) -> u32 {
        match self {
            Self::Rendering => 10,
            Self::Training => 18,
        }
    }
}

/// Workgroup memory in bytes that the largest kernel declares.
const WORKGROUP_MEMORY: u32 = 31 * 1024;
/// Immediate data in bytes of the largest kernel.
pub(super) const IMMEDIATES: u32 = 128;

/// Which adapter to use.
#[derive(Clone, Debug, Default)]
pub enum AdapterChoice {
    /// The most capable one: discrete, integrated, virtual, then software.
    #[default]
    Best,
    /// By index of [`list_adapters`] or by a part of its name.
    Named(String),
}

/// On Apple's systems Vulkan is a layer over Metal; wgpu would take it first where it is installed.
const BACKENDS: wgpu::Backends = if cfg!(target_vendor = "apple") {
    wgpu::Backends::METAL
} else {
    wgpu::Backends::VULKAN.union(wgpu::Backends::DX12)
};

pub(super) fn instance() -> wgpu::Instance {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = BACKENDS;
    wgpu::Instance::new(descriptor)
}

/// Graphics interfaces that this build can use, as `Vulkan` or `Vulkan, DirectX 12`.
pub fn backends() -> String {
    let built = wgpu::Instance::enabled_backend_features() & BACKENDS;
    let name = |backend| match backend {
        wgpu::Backends::METAL => "Metal",
        wgpu::Backends::DX12 => "DirectX 12",
        _ => "Vulkan",
    };
    built.iter().map(name).collect::<Vec<_>>().join(", ")
}

/// All adapters of this machine.
pub fn list_adapters() -> Vec<wgpu::Adapter> {
    pollster::block_on(instance().enumerate_adapters(wgpu::Backends::all()))
}

/// What an adapter lacks for a use; empty when it will do.
pub fn lacking(adapter: &wgpu::Adapter, wanted: Use) -> Vec<String> {
    missing(&adapter.limits(), wanted)
}

pub(super) fn missing(limits: &wgpu::Limits, wanted: Use) -> Vec<String> {
    let mut missing = Vec::new();
    let mut need = |name: &str, has: u64, wanted: u64| {
        if has < wanted {
            missing.push(format!("{name} {wanted} (it has {has})"));
        }
    };
    let storage_buffers = wanted.storage_buffers().into();
    need("storage buffers per stage", limits.max_storage_buffers_per_shader_stage.into(), storage_buffers);
    need("bytes of workgroup memory", limits.max_compute_workgroup_storage_size.into(), WORKGROUP_MEMORY.into());
    need("invocations per workgroup", limits.max_compute_invocations_per_workgroup.into(), 256);
    missing
}

/// How to ask an adapter for a device that ibgs can use: with all its features and limits.
pub fn device_descriptor(adapter: &wgpu::Adapter) -> wgpu::DeviceDescriptor<'static> {
    // A library that shares the device may generate code for anything that the adapter offers.
    let mut wanted = adapter
        .features()
        .difference(wgpu::Features::MAPPABLE_PRIMARY_BUFFERS | wgpu::Features::all_experimental_mask());
    wanted.set(wgpu::Features::EXPERIMENTAL_COOPERATIVE_MATRIX, matrix_units(adapter).is_some());
    wgpu::DeviceDescriptor {
        label: Some("ibgs"),
        required_features: wanted,
        required_limits: adapter.limits(),
        memory_hints: wgpu::MemoryHints::MemoryUsage,
        experimental_features: experimental_features(),
        ..Default::default()
    }
}

fn rank(info: &wgpu::AdapterInfo) -> u32 {
    match info.device_type {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    }
}

pub(super) fn choose(mut adapters: Vec<wgpu::Adapter>, choice: &AdapterChoice) -> Result<wgpu::Adapter, GpuError> {
    if adapters.is_empty() {
        return Err(GpuError::NoAdapter);
    }
    match choice {
        AdapterChoice::Best => {
            // Those that can train first, then those that can render; what the best unusable one lacks is reported when there is no
            // other.
            let lacks = |a: &wgpu::Adapter, wanted| !lacking(a, wanted).is_empty();
            let order = |a: &wgpu::Adapter| (lacks(a, Use::Training), lacks(a, Use::Rendering), rank(&a.get_info()));
            let best = adapters.iter().map(order).enumerate().min_by_key(|&(i, r)| (r, i));
            Ok(adapters.swap_remove(best.map_or(0, |(i, _)| i)))
        }
        AdapterChoice::Named(wanted) => {
            let lower = wanted.to_lowercase();
            let by_name = || adapters.iter().position(|a| a.get_info().name.to_lowercase().contains(&lower));
            let found = wanted.parse::<usize>().ok().filter(|&index| index < adapters.len()).or_else(by_name);
            let available = adapters
                .iter()
                .enumerate()
                .map(|(i, a)| format!("{i}: {}", a.get_info().name))
                .collect::<Vec<_>>()
                .join(", ");
            match found {
                Some(index) => Ok(adapters.swap_remove(index)),
                None => Err(GpuError::UnknownAdapter { wanted: wanted.clone(), available }),
            }
        }
    }
}
