//! The GPU: adapter and device, kernel launches, prefix sum and radix sort.

mod adapter;
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
mod uniforms;

pub use adapter::{AdapterChoice, Use, backends, device_descriptor, lacking, list_adapters};
pub use buffer::Buffer;
pub use bytes::Bytes;
pub use device::{Gpu, GpuError, Mark, MemoryKind, MemoryReport};
pub use launch::Pass;
pub use profile::Measured;
