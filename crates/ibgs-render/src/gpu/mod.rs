//! The GPU: adapter and device, kernel launches, prefix sum.

mod adapter;
mod bind_groups;
pub mod buffer;
mod bytes;
pub mod device;
mod error;
mod heap;
pub mod launch;
mod matrix;
#[cfg(not(target_arch = "wasm32"))]
mod open;
mod pipeline;
pub mod pool;
pub mod profile;
pub mod scan;
mod subgroups;
mod tested;
mod uniforms;

pub use adapter::{Use, backends, device_descriptor, lacking};
pub use buffer::{Buffer, RawBuffer};
pub use bytes::Bytes;
pub(crate) use device::at_once;
pub use device::{Gpu, Mark, MemoryKind, MemoryReport};
pub use error::GpuError;
pub use launch::{Batch, Pass, flush};
#[cfg(not(target_arch = "wasm32"))]
pub use open::{AdapterChoice, list_adapters};
pub use profile::Measured;
pub use tested::tested;
