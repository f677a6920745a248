//! What an adapter has to offer, and what is asked of it.

use super::error::GpuError;
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
            Self::Rendering => 8,
            Self::Training => 18,
        }
    }

    /// Workgroup memory in bytes that the largest kernel declares.
    fn workgroup_memory(self) -> u32 {
        match self {
            Self::Rendering => 16 << 10,
            Self::Training => 31 << 10,
        }
    }
}

/// Immediate data in bytes of the largest kernel.
pub(super) const IMMEDIATES: u32 = 128;

/// On Apple's systems Vulkan is a layer over Metal; wgpu would take it first where it is installed.
pub(super) const BACKENDS: wgpu::Backends = if cfg!(target_arch = "wasm32") {
    wgpu::Backends::BROWSER_WEBGPU
} else if cfg!(target_vendor = "apple") {
    wgpu::Backends::METAL
} else {
    wgpu::Backends::VULKAN.union(wgpu::Backends::DX12)
};

/// Graphics interfaces that this build can use, as `Vulkan` or `Vulkan, DirectX 12`.
pub fn backends() -> String {
    let built = wgpu::Instance::enabled_backend_features() & BACKENDS;
    let name = |backend| match backend {
        wgpu::Backends::METAL => "Metal",
        wgpu::Backends::DX12 => "DirectX 12",
        wgpu::Backends::BROWSER_WEBGPU => "WebGPU",
        _ => "Vulkan",
    };
    built.iter().map(name).collect::<Vec<_>>().join(", ")
}

/// What an adapter lacks for a use; empty when it will do.
pub fn lacking(adapter: &wgpu::Adapter, wanted: Use) -> Vec<String> {
    missing(&adapter.limits(), wanted)
}

fn missing(limits: &wgpu::Limits, wanted: Use) -> Vec<String> {
    let mut missing = Vec::new();
    let mut need = |name: &str, has: u64, wanted: u64| {
        if has < wanted {
            missing.push(format!("{name} {wanted} (it has {has})"));
        }
    };
    let storage_buffers = wanted.storage_buffers().into();
    need("storage buffers per stage", limits.max_storage_buffers_per_shader_stage.into(), storage_buffers);
    need(
        "bytes of workgroup memory",
        limits.max_compute_workgroup_storage_size.into(),
        wanted.workgroup_memory().into(),
    );
    need("invocations per workgroup", limits.max_compute_invocations_per_workgroup.into(), 256);
    missing
}

/// Fails where the limits of a device are too low for a use.
///
/// # Errors
/// [`GpuError::Lacking`].
pub(super) fn require(info: &wgpu::AdapterInfo, limits: &wgpu::Limits, wanted: Use) -> Result<(), GpuError> {
    let missing = missing(limits, wanted);
    if missing.is_empty() {
        return Ok(());
    }
    Err(GpuError::Lacking { adapter: info.name.clone(), missing: missing.join(", ") })
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
