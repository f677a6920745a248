//! How much memory a device has left.

use super::Gpu;

impl Gpu {
    /// Bytes of the device's largest local heap that this program may use in all: what other programs leave free, or
    /// the whole heap if the driver does not report that (`VK_EXT_memory_budget`). None without Vulkan, as wgpu has no
    /// such query, and for a software adapter, which uses the machine's memory whatever Vulkan reports.
    pub fn memory_bytes(&self) -> Option<u64> {
        heap(&self.adapter).filter(|_| !self.is_software())
    }
}

#[cfg(not(any(target_vendor = "apple", target_arch = "wasm32")))]
#[expect(unsafe_code, reason = "wgpu has no safe way to ask")]
fn heap(adapter: &wgpu::Adapter) -> Option<u64> {
    use ash::{ext, vk};

    // SAFETY: the adapter is only asked, and neither it nor what belongs to it is kept or destroyed. The second question is part of
    // Vulkan 1.1, and its extension is the device's.
    let (properties, budget) = unsafe {
        let adapter = adapter.as_hal::<wgpu::hal::api::Vulkan>()?;
        let (shared, device) = (adapter.shared_instance(), adapter.raw_physical_device());
        let (instance, capabilities) = (shared.raw_instance(), adapter.physical_device_capabilities());
        let version = shared.instance_api_version().min(capabilities.properties().api_version);
        if version >= vk::API_VERSION_1_1 && capabilities.supports_extension(ext::memory_budget::NAME) {
            let mut budget = vk::PhysicalDeviceMemoryBudgetPropertiesEXT::default();
            let mut properties = vk::PhysicalDeviceMemoryProperties2::default().push_next(&mut budget);
            instance.get_physical_device_memory_properties2(device, &mut properties);
            (properties.memory_properties, budget.heap_budget)
        } else {
            let properties = instance.get_physical_device_memory_properties(device);
            (properties, properties.memory_heaps.map(|heap| heap.size))
        }
    };
    let heaps = properties.memory_heaps_as_slice().iter().zip(budget);
    let own = heaps.filter(|(heap, _)| heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL));
    own.max_by_key(|(heap, _)| heap.size).map(|(heap, budget)| budget.min(heap.size))
}

#[cfg(any(target_vendor = "apple", target_arch = "wasm32"))]
fn heap(_: &wgpu::Adapter) -> Option<u64> {
    None
}
