//! How much of a GPU's memory the source photos and depth maps may take.

use crate::gpu::Gpu;
pub use ibgs_data::memory::MemoryBudget;

const GIB: u64 = 1 << 30;

/// Bytes of [`MemoryBudget::Auto`] on a card with memory of its own.
pub const AUTO_OF_CARDS: u64 = 4 * GIB;

impl Gpu {
    /// A budget in bytes on this adapter; none: no limit.
    ///
    /// wgpu does not report how much memory a device has or has left, so `auto` is a guess: 4 GiB on a card with memory of its
    /// own (half of the 8 GiB that cards of this class have at least; 300 photos of 2000 x 1500 pixels fit), 1 GiB where
    /// the GPU shares the host's memory, which already holds every photo once. Where the guess is too large the store
    /// shrinks to what it could get.
    pub fn bytes_of(&self, budget: MemoryBudget) -> Option<u64> {
        match budget {
            MemoryBudget::Unlimited => None,
            MemoryBudget::Bytes(bytes) => Some(bytes),
            MemoryBudget::Auto => match self.info.device_type {
                wgpu::DeviceType::DiscreteGpu | wgpu::DeviceType::VirtualGpu => Some(AUTO_OF_CARDS),
                _ => Some(GIB),
            },
        }
    }
}
