//! How much memory a device has.

use super::Gpu;

impl Gpu {
    /// Bytes of the device's largest heap of its own memory; none where Vulkan does not tell, for wgpu has no such question, and
    /// of a software adapter, which takes the machine's memory whatever it says.
    pub fn memory_bytes(&self) -> Option<u64> {
        heap(&self.adapter).filter(|_| !self.is_software())
    }
}

#[cfg(not(target_vendor = "apple"))]
#[expect(unsafe_code, reason = "wgpu has no safe way to ask")]
fn heap(adapter: &wgpu::Adapter) -> Option<u64> {
    const DEVICE_LOCAL: u32 = 1;
    // SAFETY: the adapter is only asked, and neither it nor what belongs to it is kept or destroyed.
    let properties = unsafe {
        let adapter = adapter.as_hal::<wgpu::hal::api::Vulkan>()?;
        let instance = adapter.shared_instance().raw_instance();
        instance.get_physical_device_memory_properties(adapter.raw_physical_device())
    };
    let heaps = properties.memory_heaps.iter().take(properties.memory_heap_count as usize);
    heaps.filter(|heap| heap.flags.as_raw() & DEVICE_LOCAL != 0).map(|heap| heap.size).max()
}

#[cfg(target_vendor = "apple")]
fn heap(_: &wgpu::Adapter) -> Option<u64> {
    None
}
