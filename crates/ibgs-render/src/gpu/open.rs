//! Opening an adapter of this machine. A browser does not let a program wait for one: there the page's device is taken over
//! ([`Gpu::from_wgpu`]).

use super::adapter::{BACKENDS, Use, device_descriptor, lacking, require};
use super::{Gpu, GpuError};
use std::sync::Arc;

/// Which adapter to use.
#[derive(Clone, Debug, Default)]
pub enum AdapterChoice {
    /// The most capable one: discrete, integrated, virtual, then software.
    #[default]
    Best,
    /// By index of [`list_adapters`] or by a part of its name.
    Named(String),
}

fn instance() -> wgpu::Instance {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = BACKENDS;
    wgpu::Instance::new(descriptor)
}

/// All adapters of this machine.
pub fn list_adapters() -> Vec<wgpu::Adapter> {
    pollster::block_on(instance().enumerate_adapters(wgpu::Backends::all()))
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

fn choose(mut adapters: Vec<wgpu::Adapter>, choice: &AdapterChoice, wanted: Use) -> Result<wgpu::Adapter, GpuError> {
    if adapters.is_empty() {
        return Err(GpuError::NoAdapter);
    }
    match choice {
        AdapterChoice::Best => {
            // Usable ones first; what the best unusable one lacks is reported when there is no other.
            let order = |a: &wgpu::Adapter| (!lacking(a, wanted).is_empty(), rank(&a.get_info()));
            let best = adapters.iter().map(order).enumerate().min_by_key(|&(i, r)| (r, i));
            Ok(adapters.swap_remove(best.map_or(0, |(i, _)| i)))
        }
        AdapterChoice::Named(named) => {
            let lower = named.to_lowercase();
            let by_name = || adapters.iter().position(|a| a.get_info().name.to_lowercase().contains(&lower));
            let found = named.parse::<usize>().ok().filter(|&index| index < adapters.len()).or_else(by_name);
            let available = adapters
                .iter()
                .enumerate()
                .map(|(i, a)| format!("{i}: {}", a.get_info().name))
                .collect::<Vec<_>>()
                .join(", ");
            match found {
                Some(index) => Ok(adapters.swap_remove(index)),
                None => Err(GpuError::UnknownAdapter { wanted: named.clone(), available }),
            }
        }
    }
}

impl Gpu {
    /// Opens the chosen adapter with all its features and limits, for this use.
    ///
    /// # Errors
    /// No such adapter, one that lacks a needed limit, or a driver that refuses.
    pub fn open(choice: &AdapterChoice, wanted: Use) -> Result<Arc<Gpu>, GpuError> {
        let instance = instance();
        let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
        let adapter = choose(adapters, choice, wanted)?;
        let info = adapter.get_info();
        require(&info, &adapter.limits(), wanted)?;
        let refused = |reason: String| GpuError::Device { adapter: info.name.clone(), reason };
        let (device, queue) = pollster::block_on(adapter.request_device(&device_descriptor(&adapter)))
            .map_err(|e| refused(e.to_string()))?;
        let mut gpu = Self::untested(instance, adapter, device, queue)?;
        gpu.is_own = true;
        let gpu = gpu.with_right_subgroups()?;
        gpu.watch();
        Ok(gpu)
    }
}
