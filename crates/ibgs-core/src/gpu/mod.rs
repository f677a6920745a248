//! The GPU: adapter and device, kernel launches, prefix sum and radix sort.

pub mod buffer;
mod bytes;
pub mod device;
mod heap;
pub mod launch;
mod matrix;
pub mod pool;
pub mod profile;
pub mod scan;
pub mod sort;

pub use buffer::Buffer;
pub use bytes::Bytes;
pub use device::{
    AdapterChoice, Gpu, GpuError, Mark, MemoryKind, MemoryReport, backends, device_descriptor, list_adapters,
};
pub use launch::Pass;
pub use profile::Measured;
